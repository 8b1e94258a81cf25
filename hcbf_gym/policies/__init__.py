"""Nominal policies: what the robot would do if nothing were dangerous."""

from hcbf_gym.policies.learned import LearnedPolicy, load
from hcbf_gym.policies.named import FORMS, check, files, is_own, make, names, register, try_out
from hcbf_gym.policies.pd import PDTracker, Policy

__all__ = [
    "FORMS",
    "LearnedPolicy",
    "PDTracker",
    "Policy",
    "check",
    "files",
    "is_own",
    "load",
    "make",
    "names",
    "register",
    "try_out",
]
