"""Safety conditions h(x, t) ≥ 0 with their ranks, and the rows a·u ≥ b that they become."""

from hcbf_gym.barriers.barrier import Barrier, Core, Jet, PlanarBarrier
from hcbf_gym.barriers.class_k import ClassK, LinearClassK, LogClassK
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.general import GeneralRows
from hcbf_gym.barriers.held import held_rows
from hcbf_gym.barriers.many import Shapes
from hcbf_gym.barriers.registry import from_dict, register, to_dict
from hcbf_gym.barriers.rows import CbfRows, RowSettings
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.shapes import ConvexPolygon, Disc, Ellipse, HalfPlane, SpeedLimit

__all__ = [
    "Barrier",
    "BarrierSet",
    "CbfRows",
    "ClassK",
    "ConvexPolygon",
    "Core",
    "Disc",
    "Ellipse",
    "Function",
    "GeneralRows",
    "HalfPlane",
    "Jet",
    "LinearClassK",
    "LogClassK",
    "PlanarBarrier",
    "RowSettings",
    "Shapes",
    "SpeedLimit",
    "from_dict",
    "held_rows",
    "register",
    "to_dict",
]
