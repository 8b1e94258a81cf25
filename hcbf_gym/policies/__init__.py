"""Nominal policies: what the robot would do if nothing were dangerous."""

from hcbf_gym.policies.learned import LearnedPolicy, load
from hcbf_gym.policies.pd import PDTracker, Policy

__all__ = ["LearnedPolicy", "PDTracker", "Policy", "load"]
