"""A superellipse of the fourth degree: between an ellipse and a box."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numba import njit

from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Pair
from hcbf_gym.barriers.shape import (
    TINY,
    Array,
    Compiled,
    Planar,
    PlanarJet,
    Shape,
    set_pairs,
    shifted,
)
from hcbf_gym.errors import finite_float

CODE = 5
CENTER_X, CENTER_Y, HALF_X, HALF_Y = 2, 3, 4, 5  # [m]


@njit(cache=True)
def write(c: Array, velocity: Pair, center: Pair, semi_axes: Pair) -> int:
    """Write the outside of a superellipse into the block c (WIDTH,)."""
    c[:] = 0.0
    c[layout.VELOCITY_X], c[layout.VELOCITY_Y] = velocity
    c[CENTER_X], c[CENTER_Y] = center
    c[HALF_X], c[HALF_Y] = semi_axes
    return CODE


@njit(cache=True, error_model="numpy")
def jet(c: Array, x: float, y: float) -> PlanarJet:
    """Return H and its derivatives; see `Compiled`. H + s is homogeneous: ∇²H has rank one."""
    dx, dy = x - c[CENTER_X], y - c[CENTER_Y]
    p, q, scale = dx / c[HALF_X], dy / c[HALF_Y], min(c[HALF_X], c[HALF_Y])
    n = np.sqrt(np.sqrt(p**4 + q**4))
    if n < TINY:
        return -scale, scale / c[HALF_X], 0.0, np.inf, 0.0, 1.0
    gx, gy = scale * (p / n) ** 3 / c[HALF_X], scale * (q / n) ** 3 / c[HALF_Y]
    bend = np.sqrt(3.0) * scale * abs(p * q) / (n * n * n * c[HALF_X] * c[HALF_Y])
    return scale * (n - 1.0), gx, gy, scale * n, -bend * dy, bend * dx


@njit(cache=True, error_model="numpy")
def core(
    c: Array, x: float, y: float, h: float, distance: float, reach: float
) -> tuple[float, float, bool]:
    """Return the centre, taken for a set: which way round it is nearer is not known."""
    scale = min(c[HALF_X], c[HALF_Y])
    return h + scale, scale, False


@njit(cache=True, error_model="numpy")
def bounds(c: Array) -> tuple[float, float, float, float]:
    """Return the corners of the box around it."""
    x, y, half_x, half_y = c[CENTER_X], c[CENTER_Y], c[HALF_X], c[HALF_Y]
    return x - half_x, y - half_y, x + half_x, y + half_y


@dataclass(frozen=True)
class Superellipse(Shape):
    """The outside of a superellipse, ``h = min(a, b) (‖(x/a, y/b)‖₄ − 1)``; ‖∇h‖ ≤ 1.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        center: (2,) at t = 0 [m].
        semi_axes: (2,) a and b along x and y [m], positive.
        velocity: (2,) of the centre [m/s].

    Raises:
        InvalidInputError: if a semi-axis is not positive or a number is not finite.
    """

    center: Pair = (0.0, 0.0)
    semi_axes: Pair = (1.0, 1.0)
    velocity: Pair = (0.0, 0.0)
    kind: ClassVar[str] = "superellipse"
    compiled: ClassVar[Compiled] = Compiled(CODE, jet, core, bounds, is_distance=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        set_pairs(self, "center", "velocity", "semi_axes")
        for axis in self.semi_axes:
            finite_float(f"{self.name}: semi_axes", axis, minimum=0.0, exclusive=True)

    def write(self, c: Array) -> int:
        """Write the block c (WIDTH,)."""
        return write(c, self.velocity, self.center, self.semi_axes)

    def outline(self) -> Array:
        """Return (64, 2) points of it."""
        turn = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
        circle = np.column_stack([np.cos(turn), np.sin(turn)])
        circle /= np.sum(circle**4, axis=1, keepdims=True) ** 0.25
        return self.center + circle * self.semi_axes

    def traced(self, jax: Any) -> Planar:
        """Return (x, y) → H for JAX."""
        (cx, cy), (a, b), where = self.center, self.semi_axes, jax.numpy.where

        def value(x: Any, y: Any) -> Any:
            p, q = (x - cx) / a, (y - cy) / b
            fourth = p**4 + q**4
            apart = fourth > TINY**4
            norm = where(apart, jax.numpy.sqrt(jax.numpy.sqrt(where(apart, fourth, 1.0))), p)
            return min(a, b) * (norm - 1.0)

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
        """Return it a step (2,) away."""
        return replace(self, center=shifted(self.center, step))

    def resized(self, size: float) -> Self:
        """Return one of another larger semi-axis, and the same ratio of both."""
        a, b = self.semi_axes
        return replace(self, semi_axes=(size / self.size * a, size / self.size * b))
