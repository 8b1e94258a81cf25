"""The filter without Gymnasium: a velocity and a pose in, a velocity out."""

from hcbf_gym.online.robot import Robot
from hcbf_gym.online.velocity_filter import VelocityFilter
from hcbf_gym.robots.walker_parts import Command
from hcbf_gym.robots.walker_response import Response

__all__ = ["Command", "Response", "Robot", "VelocityFilter"]
