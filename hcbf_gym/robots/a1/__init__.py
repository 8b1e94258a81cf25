"""Unitree A1: the model file and the facts that a model file does not carry."""

from hcbf_gym.robots.a1.constants import (
    CALF_LENGTH,
    FOOT_RADIUS,
    HOME_HEIGHT,
    HOME_JOINTS,
    JOINTS,
    LEGS,
    TORQUE_LIMIT,
    TRUNK,
    XML_FILE,
)

__all__ = [
    "CALF_LENGTH",
    "FOOT_RADIUS",
    "HOME_HEIGHT",
    "HOME_JOINTS",
    "JOINTS",
    "LEGS",
    "TORQUE_LIMIT",
    "TRUNK",
    "XML_FILE",
]
