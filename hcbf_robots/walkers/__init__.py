"""Robots that take velocities: their contracts, policies, margins and response."""

from hcbf_robots.walkers.walker import Walker

__all__ = ["Walker"]
