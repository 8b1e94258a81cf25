"""Guidance: fields of shortest paths to the goal, and the row of the last rank along them."""

from hcbf_gym.guidance.geodesic import Geodesic
from hcbf_gym.guidance.local import Local
from hcbf_gym.guidance.row import Pull

__all__ = ["Geodesic", "Local", "Pull"]
