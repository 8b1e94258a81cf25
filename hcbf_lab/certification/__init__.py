"""Calibrate, freeze, certify: from episodes of a plant to a bound on entries.

A family of episodes is a frozen record whose `episode` makes the episode of a seed; its fields
decide every episode, so that a certificate's JSON is enough to repeat any of them.
"""
