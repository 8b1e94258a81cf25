"""Guidance: fields of shortest paths to the goal, and the row of the last rank along them."""

from hcbf_gym.guidance.field import Pull
from hcbf_gym.guidance.geodesic import Geodesic
from hcbf_gym.guidance.local import Local

__all__ = ["Geodesic", "Local", "Pull"]
