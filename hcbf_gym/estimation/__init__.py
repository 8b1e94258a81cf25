"""Sensors with their errors, and the state estimated from them."""

from hcbf_gym.estimation.estimator import Estimator, PlanarEstimate
from hcbf_gym.estimation.sensors import PRESETS, Sensors

__all__ = ["PRESETS", "Estimator", "PlanarEstimate", "Sensors"]
