"""Wrappers around the environments."""

from hcbf_gym.wrappers.safety_filter import SafetyFilter, VectorSafetyFilter

__all__ = ["SafetyFilter", "VectorSafetyFilter"]
