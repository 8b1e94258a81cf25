"""Weights by sampling (paper, section III-C): draws, their costs, and studies that hold them."""

from hcbf_gym.tuning.cost import Cost
from hcbf_gym.tuning.draws import Normal
from hcbf_gym.tuning.problem import Problem
from hcbf_gym.tuning.simulate import Simulation, simulate
from hcbf_gym.tuning.study import SAMPLERS, WINDOW, Samples, TuningStudy

__all__ = [
    "SAMPLERS",
    "WINDOW",
    "Cost",
    "Normal",
    "Problem",
    "Samples",
    "Simulation",
    "TuningStudy",
    "simulate",
]
