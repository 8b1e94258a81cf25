"""The filter without Gymnasium: a velocity and a pose in, a velocity out."""

from hcbf_robots.online.robot import Robot
from hcbf_robots.online.velocity_filter import VelocityFilter
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import Response

__all__ = ["Command", "Response", "Robot", "VelocityFilter"]
