"""The filter without Gymnasium: a velocity and a pose in, a velocity out."""

from hcbf_gym.online.velocity_filter import Robot, VelocityFilter

__all__ = ["Robot", "VelocityFilter"]
