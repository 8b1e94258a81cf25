"""Wrappers around the environments; `wrappers.sb3`, which needs the extra `rl`, by its own name."""

from hcbf_gym.wrappers.cost import CostStep
from hcbf_gym.wrappers.intervention import InterventionPenalty, VectorInterventionPenalty
from hcbf_gym.wrappers.safety_filter import SafetyFilter, VectorSafetyFilter

__all__ = [
    "CostStep",
    "InterventionPenalty",
    "SafetyFilter",
    "VectorInterventionPenalty",
    "VectorSafetyFilter",
]
