"""Unitree A1: the model file and the names of its parts."""

from hcbf_gym.robots.a1.constants import JOINTS, LEGS, TRUNK, XML_FILE

__all__ = ["JOINTS", "LEGS", "TRUNK", "XML_FILE"]
