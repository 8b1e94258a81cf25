"""Wrappers of environments. `wrappers.sb3` is imported by its name, as it needs the extra `rl`."""

from hcbf_gym.wrappers.filter_log import FilterLog
from hcbf_gym.wrappers.hold import HoldAction, VectorHoldAction
from hcbf_gym.wrappers.intervention import InterventionPenalty, VectorInterventionPenalty
from hcbf_gym.wrappers.ranked import RankedObservation, VectorRankedObservation
from hcbf_gym.wrappers.safety_filter import SafetyFilter
from hcbf_gym.wrappers.vector_safety_filter import VectorSafetyFilter

__all__ = [
    "FilterLog",
    "HoldAction",
    "InterventionPenalty",
    "RankedObservation",
    "SafetyFilter",
    "VectorHoldAction",
    "VectorInterventionPenalty",
    "VectorRankedObservation",
    "VectorSafetyFilter",
]
