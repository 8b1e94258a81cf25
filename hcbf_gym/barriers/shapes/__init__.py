"""The built-in shapes, and how compiled code finds the functions of one by its kind.

A new shape is a file here with its name in `SHAPES`, and a header in core/include/hcbf with a line
in each function of shapes.hpp.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.shape import PlanarJet, Shape
from hcbf_gym.barriers.shapes import capsule, convex_polygon, disc, ellipse, half_plane
from hcbf_gym.barriers.shapes.capsule import Capsule
from hcbf_gym.barriers.shapes.convex_polygon import ConvexPolygon
from hcbf_gym.barriers.shapes.disc import Disc
from hcbf_gym.barriers.shapes.ellipse import Ellipse
from hcbf_gym.barriers.shapes.half_plane import HalfPlane
from hcbf_gym.compilation import kernel

__all__ = ["Capsule", "ConvexPolygon", "Disc", "Ellipse", "HalfPlane"]

SHAPES: tuple[type[Shape], ...] = (HalfPlane, Disc, Ellipse, ConvexPolygon, Capsule)


@kernel(error_model="numpy", inline="always")
def jet(kind: int, c: Array, x: float, y: float) -> PlanarJet:
    """Return H and its derivatives at a point of the shape's frame, infinity for what is no shape.

    Returns:
        H, ∇H (x, y), d, t (x, y), where ``∇²H = t tᵀ / d``; see `Compiled`.
    """
    if kind == half_plane.CODE:
        return half_plane.jet(c, x, y)
    if kind == disc.CODE:
        return disc.jet(c, x, y)
    if kind == ellipse.CODE:
        return ellipse.jet(c, x, y)
    if kind == convex_polygon.CODE:
        return convex_polygon.jet(c, x, y)
    if kind == capsule.CODE:
        return capsule.jet(c, x, y)
    return np.inf, 0.0, 0.0, np.inf, 0.0, 0.0


@kernel(error_model="numpy", inline="always")
def core(
    kind: int, c: Array, x: float, y: float, h: float, distance: float, reach: float
) -> tuple[float, float, bool]:
    """Return the distance from the core of a shape, its radius, and whether it is a point.

    Args:
        kind: which shape.
        c: (WIDTH,) its block.
        x: of a point in its frame [m].
        y: of the point [m].
        h: H there [m].
        distance: d there [m].
        reach: how far the robot gets in one period [m].
    """
    if kind == half_plane.CODE:
        return half_plane.core(c, x, y, h, distance, reach)
    if kind == disc.CODE:
        return disc.core(c, x, y, h, distance, reach)
    if kind == ellipse.CODE:
        return ellipse.core(c, x, y, h, distance, reach)
    if kind == convex_polygon.CODE:
        return convex_polygon.core(c, x, y, h, distance, reach)
    if kind == capsule.CODE:
        return capsule.core(c, x, y, h, distance, reach)
    return np.inf, np.inf, False


@kernel(error_model="numpy")
def bounds(kind: int, c: Array) -> tuple[float, float, float, float]:
    """Return least x and y and greatest x and y of a region at time 0 [m]; see `Compiled`."""
    if kind == disc.CODE:
        return disc.bounds(c)
    if kind == ellipse.CODE:
        return ellipse.bounds(c)
    if kind == convex_polygon.CODE:
        return convex_polygon.bounds(c)
    if kind == capsule.CODE:
        return capsule.bounds(c)
    return half_plane.bounds(c)
