"""Safety conditions h(x, t) ≥ 0 with their ranks, and the rows a·u ≥ b that they become."""

from hcbf_gym.barriers import shapes
from hcbf_gym.barriers.barrier import Barrier, Core, Jet, PlanarBarrier
from hcbf_gym.barriers.class_k import BrakeClassK, ClassK, LinearClassK, LogClassK
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.general import GeneralRows
from hcbf_gym.barriers.many import Shapes
from hcbf_gym.barriers.registry import from_dict, register, to_dict
from hcbf_gym.barriers.rows import CbfRows, RowSettings
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.shape import Oval, Shape, Wall
from hcbf_gym.barriers.shapes import *  # noqa: F403 (what shapes there are stands there alone)
from hcbf_gym.barriers.speed_limit import SpeedLimit

__all__ = [
    "Barrier",
    "BarrierSet",
    "BrakeClassK",
    "CbfRows",
    "ClassK",
    "Core",
    "Function",
    "GeneralRows",
    "Jet",
    "LinearClassK",
    "LogClassK",
    "Oval",
    "PlanarBarrier",
    "RowSettings",
    "Shape",
    "Shapes",
    "SpeedLimit",
    "Wall",
    "from_dict",
    "register",
    "to_dict",
]
__all__ += shapes.__all__
