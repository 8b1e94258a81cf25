"""Weights by sampling (paper, section III-C): draws, their costs, and studies that hold them."""

from hcbf_gym.studies.tuning.cost import Cost
from hcbf_gym.studies.tuning.draws import Normal
from hcbf_gym.studies.tuning.problem import Problem
from hcbf_gym.studies.tuning.simulate import Trajectories, simulate
from hcbf_gym.studies.tuning.study import SAMPLERS, WINDOW, Samples, TuningStudy

__all__ = [
    "SAMPLERS",
    "WINDOW",
    "Cost",
    "Normal",
    "Problem",
    "Samples",
    "Trajectories",
    "TuningStudy",
    "simulate",
]
