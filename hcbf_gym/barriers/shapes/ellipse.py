"""An ellipse."""

from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any, ClassVar, Self

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Pair
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.shape import (
    TINY,
    Oval,
    Planar,
    PlanarJet,
    Shape,
    set_pairs,
    shifted,
)
from hcbf_gym.compilation import kernel
from hcbf_gym.errors import finite_float
from hcbf_gym.models.constants import ON_EARTH

CODE = 2
CENTER_X, CENTER_Y = 2, 3  # [m]
COS, SIN = 4, 5  # the direction of the longer semi-axis
LONGER, SHORTER = 6, 7  # semi-axes [m]

HAIR = 1e-13
"""How far from the longer axis a point is at least, so that its normal has a side [m]."""
MOST_STEPS = 20
"""Newton's steps to the foot of a point; three to six are taken."""
SURE_STEPS, DIFFERENTIATED = 8, 3
"""What JAX takes of them, without derivatives and with."""


@kernel()
def write(c: Array, velocity: Pair, center: Pair, semi_axes: Pair, angle: float) -> int:
    """Write the outside of an ellipse into the block c (WIDTH,)."""
    c[:] = 0.0
    c[layout.VELOCITY_X], c[layout.VELOCITY_Y] = velocity
    c[CENTER_X], c[CENTER_Y] = center
    first, second = semi_axes
    c[COS], c[SIN] = np.cos(angle), np.sin(angle)
    if second > first:
        c[COS], c[SIN] = -c[SIN], c[COS]
    c[LONGER], c[SHORTER] = max(first, second), min(first, second)
    return CODE


@kernel(error_model="numpy")
def jet(c: Array, x: float, y: float) -> PlanarJet:
    """Return H and its derivatives; see `Shape`.

    With u along the longer and v along the shorter axis, the normal at the foot of (u, v) is along
    ``w = (u / (s + a² - b²), v / s)``, where s > 0 solves ``(a w_u)² + (b w_v)² = 1``; then
    ``H = (s - b²) ‖w‖``. The reciprocal root of the left side is nearly linear and concave in s, so
    that Newton's steps come from below and are few.
    """
    dx = x - c[CENTER_X]
    dy = y - c[CENTER_Y]
    a, b, cos, sin = c[LONGER], c[SHORTER], c[COS], c[SIN]
    along = cos * dx + sin * dy
    across = cos * dy - sin * dx
    u, v = abs(along), abs(across) + HAIR
    apart = a * a - b * b
    s = max(b * v, a * u - apart)
    for _ in range(MOST_STEPS):
        wu, wv = u / (s + apart), v / s
        first, second = a * a * wu * wu, b * b * wv * wv
        size = first + second
        step = size * (np.sqrt(size) - 1.0) / (first / (s + apart) + second / s)
        s += step
        if not step > 1e-15 * s:
            break
    wu, wv = u / (s + apart), v / s
    norm = np.sqrt(wu * wu + wv * wv)
    h = (s - b * b) * norm
    distance = a * a * b * b * norm * norm * norm + h  # the radius of curvature at the foot, and h
    nu, nv = np.copysign(wu / norm, along), np.copysign(wv / norm, across)
    nx, ny = cos * nu - sin * nv, sin * nu + cos * nv
    if distance < TINY:
        distance = np.inf
    return h, nx, ny, distance, -ny, nx


@kernel(error_model="numpy")
def core(
    c: Array, x: float, y: float, h: float, distance: float, reach: float
) -> tuple[float, float, bool]:
    """Return as the core what a disc of the smallest radius of curvature, b²/a, leaves inside."""
    radius = c[SHORTER] * c[SHORTER] / c[LONGER]
    return h + radius, radius, False


@kernel(error_model="numpy")
def bounds(c: Array) -> tuple[float, float, float, float]:
    """Return the corners of the square around the circle around the ellipse."""
    x, y, longer = c[CENTER_X], c[CENTER_Y], c[LONGER]
    return x - longer, y - longer, x + longer, y + longer


@dataclass(frozen=True)
class Ellipse(Shape):
    """The outside of an ellipse: h is the signed distance to it.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        center: (2,) c when the object is first returned or set [m].
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
    code: ClassVar[int] = CODE

    def __post_init__(self) -> None:
        super().__post_init__()
        set_pairs(self, "center", largest=ON_EARTH)
        set_pairs(self, "velocity", "semi_axes")
        for axis in self.semi_axes:
            finite_float(f"{self.name}: semi_axes", axis, minimum=0.0, exclusive=True)
        object.__setattr__(self, "angle", finite_float(f"{self.name}: angle", self.angle))

    def write(self, c: Array) -> int:
        """Write the block c (WIDTH,)."""
        return _core.ellipse_write(c, self.velocity, self.center, self.semi_axes, self.angle)

    @classmethod
    def shift(cls, blocks: Array, step: Array) -> None:
        """Move the ellipses of blocks (k, WIDTH) by a step (2,) or steps (k, 2) [m]."""
        blocks[:, [CENTER_X, CENTER_Y]] += step

    def outline(self) -> Oval:
        """Return the ellipse."""
        return Oval(self.center, self.semi_axes, self.angle)

    def traced(self, jax: ModuleType) -> Planar:
        """Return (x, y) → H for JAX."""
        jnp = jax.numpy
        block = self._block
        cx, cy, cos, sin, a, b = block[[CENTER_X, CENTER_Y, COS, SIN, LONGER, SHORTER]].tolist()
        apart = a * a - b * b

        def stepped(s: Any, u: Any, v: Any) -> Any:
            first, second = (a * u / (s + apart)) ** 2, (b * v / s) ** 2
            size = first + second
            return s + size * (jnp.sqrt(size) - 1.0) / (first / (s + apart) + second / s)

        def value(x: Any, y: Any) -> Any:
            dx, dy = x - cx, y - cy
            along, across = cos * dx + sin * dy, cos * dy - sin * dx
            u = jnp.where(along >= 0.0, along, -along)
            v = jnp.where(across >= 0.0, across, -across) + HAIR
            fixed = jax.lax.stop_gradient((u, v))
            s = jnp.maximum(b * fixed[1], a * fixed[0] - apart)
            for _ in range(SURE_STEPS):
                s = stepped(s, *fixed)
            for _ in range(DIFFERENTIATED):  # each doubles how many derivatives are right
                s = stepped(s, u, v)
            return (s - b * b) * jnp.sqrt((u / (s + apart)) ** 2 + (v / s) ** 2)

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
