"""Safety conditions h(x, t) ≥ 0 with their ranks, and the rows a·u ≥ b that they become."""

from hcbf_gym.barriers.class_k import ClassK, LinearClassK, LogClassK
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.shapes import (
    Barrier,
    ConvexPolygon,
    Disc,
    Ellipse,
    HalfPlane,
    Jet,
    PlanarBarrier,
    SpeedLimit,
)

__all__ = [
    "Barrier",
    "BarrierSet",
    "CbfRows",
    "ClassK",
    "ConvexPolygon",
    "Disc",
    "Ellipse",
    "HalfPlane",
    "Jet",
    "LinearClassK",
    "LogClassK",
    "PlanarBarrier",
    "SpeedLimit",
]
