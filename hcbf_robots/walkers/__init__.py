"""Robots that accept velocities: contracts, policies, margins and response."""

from typing import TYPE_CHECKING

from hcbf_gym import lazily

if TYPE_CHECKING:
    from hcbf_robots.walkers.walker import Walker

__all__ = ["Walker"]

__getattr__ = lazily.names_of(__name__, {"Walker": "walker"})  # reads MJCF by MuJoCo
