"""Calibrate, freeze, certify: from episodes of a plant to a number for its promise.

A family of episodes is a frozen record whose `episode` says what a seed stands for; whatever
decides an episode stands in it, so that a certificate's JSON is enough to repeat any of them.
"""
