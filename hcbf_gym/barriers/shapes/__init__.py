"""The built-in shapes.

A new one is a file here with its name in `SHAPES`, and a struct in core/include/hcbf/shapes.hpp
with its name in the list there.
"""

from hcbf_gym.barriers.shape import Shape
from hcbf_gym.barriers.shapes.capsule import Capsule
from hcbf_gym.barriers.shapes.convex_polygon import ConvexPolygon
from hcbf_gym.barriers.shapes.disc import Disc
from hcbf_gym.barriers.shapes.ellipse import Ellipse
from hcbf_gym.barriers.shapes.half_plane import HalfPlane

__all__ = ["Capsule", "ConvexPolygon", "Disc", "Ellipse", "HalfPlane"]

SHAPES: tuple[type[Shape], ...] = (HalfPlane, Disc, Ellipse, ConvexPolygon, Capsule)
