"""Hostile policies against the strict rank: attacks, plants that differ, a search for the worst."""
