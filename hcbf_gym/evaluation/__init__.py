"""Rollouts, the measures taken of them, and their pictures."""
