"""Robots: what the package brings along, and the contracts by which others come."""

from hcbf_gym.robots.walker import Walker

__all__ = ["Walker"]
