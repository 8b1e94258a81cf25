"""The filter without Gymnasium: it takes a velocity and a pose, and returns a velocity."""

from hcbf_robots.online.robot import Robot
from hcbf_robots.online.velocity_filter import VelocityFilter
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import Response

__all__ = ["Command", "Response", "Robot", "VelocityFilter"]
