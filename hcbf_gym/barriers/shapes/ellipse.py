"""An ellipse."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numba import njit

from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Pair
from hcbf_gym.barriers.shape import (
    Array,
    Compiled,
    Oval,
    Planar,
    PlanarJet,
    Shape,
    point_jet,
    set_pairs,
    shifted,
    traced_norm,
)
from hcbf_gym.errors import finite_float

CODE = 2
CENTER_X, CENTER_Y = 2, 3  # [m]
MAP_XX, MAP_XY, MAP_YX, MAP_YY = 4, 5, 6, 7  # its axes as unit circle, row by row [1/m]
SHORTER_AXIS = 8  # [m]


@njit(cache=True)
def write(c: Array, velocity: Pair, center: Pair, semi_axes: Pair, angle: float) -> int:
    """Write the outside of an ellipse into the block c (WIDTH,)."""
    c[:] = 0.0
    c[layout.VELOCITY_X], c[layout.VELOCITY_Y] = velocity
    c[CENTER_X], c[CENTER_Y] = center
    first, second = semi_axes
    c[MAP_XX], c[MAP_XY] = np.cos(angle) / first, np.sin(angle) / first
    c[MAP_YX], c[MAP_YY] = -np.sin(angle) / second, np.cos(angle) / second
    c[SHORTER_AXIS] = min(first, second)
    return CODE


@njit(cache=True, error_model="numpy")
def jet(c: Array, x: float, y: float) -> PlanarJet:
    """Return H and its derivatives; see `Compiled`."""
    dx = x - c[CENTER_X]
    dy = y - c[CENTER_Y]
    scale = c[SHORTER_AXIS]
    xx, xy = scale * c[MAP_XX], scale * c[MAP_XY]
    yx, yy = scale * c[MAP_YX], scale * c[MAP_YY]
    n, nx, ny, distance, tx, ty = point_jet(xx * dx + xy * dy, yx * dx + yy * dy)
    return (
        n - scale,
        xx * nx + yx * ny,
        xy * nx + yy * ny,
        distance,
        xx * tx + yx * ty,
        xy * tx + yy * ty,
    )


@njit(cache=True, error_model="numpy")
def core(
    c: Array, x: float, y: float, h: float, distance: float, reach: float
) -> tuple[float, float, bool]:
    """Return the centre as the core: shortened along its long axis, an ellipse is a disc.

    In the coordinates min(a, b) z, which shorten every way, it is a disc of radius min(a, b).
    """
    return distance, c[SHORTER_AXIS], True


@njit(cache=True, error_model="numpy")
def bounds(c: Array) -> tuple[float, float, float, float]:
    """Return the corners of the square around the circle around the ellipse."""
    first = c[MAP_XX] ** 2 + c[MAP_XY] ** 2
    second = c[MAP_YX] ** 2 + c[MAP_YY] ** 2
    x = c[CENTER_X]
    y = c[CENTER_Y]
    longer = 1.0 / np.sqrt(min(first, second))
    return x - longer, y - longer, x + longer, y + longer


@dataclass(frozen=True)
class Ellipse(Shape):
    """The outside of an ellipse, ``h = min(a, b) (√(zᵀz) − 1)``, ``z = diag(1/a, 1/b) Rᵀ(p − c)``.

    h is zero on the ellipse and never exceeds the distance to it, as |∇h| ≤ 1.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        center: (2,) c at t = 0 [m].
        semi_axes: (2,) a and b [m], positive.
        angle: of the first semi-axis from the world's x axis [rad].
        velocity: (2,) of the centre [m/s].

    Raises:
        InvalidInputError: if a semi-axis is not positive or a number is not finite.
    """

    center: Pair = (0.0, 0.0)
    semi_axes: Pair = (1.0, 1.0)
    angle: float = 0.0
    velocity: Pair = (0.0, 0.0)
    kind: ClassVar[str] = "ellipse"
    compiled: ClassVar[Compiled] = Compiled(CODE, jet, core, bounds, is_distance=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        set_pairs(self, "center", "velocity", "semi_axes")
        for axis in self.semi_axes:
            finite_float(f"{self.name}: semi_axes", axis, minimum=0.0, exclusive=True)
        object.__setattr__(self, "angle", finite_float(f"{self.name}: angle", self.angle))

    def write(self, c: Array) -> int:
        """Write the block c (WIDTH,)."""
        return write(c, self.velocity, self.center, self.semi_axes, self.angle)

    def outline(self) -> Oval:
        """Return the ellipse."""
        return Oval(self.center, self.semi_axes, self.angle)

    def traced(self, jax: Any) -> Planar:
        """Return (x, y) → H for JAX."""
        (cx, cy), (first, second) = self.center, self.semi_axes
        cos = np.cos(self.angle)
        sin = np.sin(self.angle)
        scale = min(first, second)

        def value(x: Any, y: Any) -> Any:
            dx, dy = x - cx, y - cy
            along = (cos * dx + sin * dy) / first
            across = (cos * dy - sin * dx) / second
            return scale * (traced_norm(jax, along, across) - 1.0)

        return value

    @property
    def anchor(self) -> Array:
        """(2,) the centre [m]."""
        return np.array(self.center)

    @property
    def size(self) -> float:
        """The larger semi-axis [m]."""
        return max(self.semi_axes)

    def moved(self, step: Array) -> Self:
        """Return the ellipse a step (2,) away."""
        return replace(self, center=shifted(self.center, step))

    def resized(self, size: float) -> Self:
        """Return an ellipse of another larger semi-axis, and the same ratio of both."""
        first, second = self.semi_axes
        factor = size / self.size
        return replace(self, semi_axes=(factor * first, factor * second))
