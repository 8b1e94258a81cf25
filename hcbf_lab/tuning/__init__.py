"""Weights by sampling (paper, section III-C): draws of weights, their costs, and studies."""

from hcbf_lab.tuning.cost import Cost
from hcbf_lab.tuning.draws import Normal
from hcbf_lab.tuning.problem import Problem
from hcbf_lab.tuning.simulate import Trajectories, simulate
from hcbf_lab.tuning.study import SAMPLERS, WINDOW, Samples, TuningStudy

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
