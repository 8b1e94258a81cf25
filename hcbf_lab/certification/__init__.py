"""Calibrate, freeze, certify: from episodes of a plant to a bound on its entries into rank 1.

A family is a frozen record whose method `episode` returns the episode of a seed. Its fields decide
every episode, so that a certificate's JSON is enough to repeat any of them.
"""
