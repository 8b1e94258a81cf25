"""An ellipse."""

from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any, ClassVar, Self

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Pair
from hcbf_gym.barriers.shape import Oval, Planar, Shape, set_pairs, shifted
from hcbf_gym.errors import finite_float
from hcbf_gym.models.constants import ON_EARTH

CODE = 2
CENTER_X, CENTER_Y = 2, 3  # [m]
COS, SIN = 4, 5  # the direction of the longer semi-axis
LONGER, SHORTER = 6, 7  # semi-axes [m]

HAIR = 1e-13
"""How far from the longer axis a point is at least, so that its normal has a side [m]."""
SURE_STEPS, DIFFERENTIATED = 8, 3
"""What JAX takes of them, without derivatives and with."""


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
