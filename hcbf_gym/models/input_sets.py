"""Input sets U: convex polytopes that contain u = 0, with which a plant brakes."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import records
from hcbf_gym.arrays import Array
from hcbf_gym.errors import (
    InvalidInputError,
    check_not_overridden,
    count,
    finite_array,
    finite_float,
    reals,
    shown,
)


def _entries(name: str, value: object, n: int) -> Array:
    """Return (n,) real numbers, which may be NaN or infinite."""
    numbers = reals(name, value)
    if numbers.shape != (n,):
        raise InvalidInputError(f"{name}: got shape {numbers.shape}, expected ({n},)")
    return numbers


@dataclass(frozen=True, eq=False)
class Box:
    """The box ``low ≤ u ≤ high``, elementwise.

    Args:
        low: (n_u,) lower limits, at most 0 [m/s² for the double integrator].
        high: (n_u,) upper limits, at least 0.

    Raises:
        InvalidInputError: if the limits are not finite, the box is empty or has no interior, or it
            does not contain the braking action 0.
    """

    low: Array
    high: Array

    def __init__(self, low: ArrayLike, high: ArrayLike) -> None:
        lower = finite_array("low", low, (None,))
        upper = finite_array("high", high, lower.shape)
        if not lower.size:
            raise InvalidInputError("low: it is empty, expected an entry for each input")
        got = f"input set: got low {lower.tolist()} and high {upper.tolist()}"
        if not (lower < upper).all():
            raise InvalidInputError(f"{got}, expected low < high")
        if (lower > 0.0).any() or (upper < 0.0).any():
            raise InvalidInputError(f"{got}, expected a set that contains the braking action 0")
        for name, limits in (("low", lower), ("high", upper)):
            limits.flags.writeable = False
            object.__setattr__(self, name, limits)

    @classmethod
    def symmetric(cls, limit: float, n_u: int = 2) -> Self:
        """Return ``|u_i| ≤ limit`` (paper, section IV-A: limit 5 m/s², two inputs)."""
        bound = finite_float("limit", limit, minimum=0.0, exclusive=True)
        bound = np.full(count("n_u", n_u), bound)
        return cls(-bound, bound)

    @property
    def n_u(self) -> int:
        """The number of inputs."""
        return self.low.size

    @cached_property
    def radius(self) -> float:
        """The largest norm of an input in the set."""
        return float(np.linalg.norm(np.maximum(-self.low, self.high)))

    def halfspaces(self) -> tuple[Array, Array]:
        """Return A (2 n_u, n_u) and b (2 n_u,) with ``U = {u : A u ≥ b}`` and unit rows."""
        identity = np.eye(self.n_u)
        return np.vstack((identity, -identity)), np.concatenate((self.low, -self.high))

    def contains(self, u: ArrayLike, tolerance: float = 1e-9) -> bool:
        """Return whether u (n_u,) is in the set, or at most `tolerance` outside a limit."""
        tolerance = finite_float("tolerance", tolerance)
        entries = _entries("u", u, self.n_u).tolist()
        limits = zip(entries, self.low.tolist(), self.high.tolist(), strict=True)
        return all(low - tolerance <= x <= high + tolerance for x, low, high in limits)

    def support(self, a: Array) -> float:
        """Return the largest a·u of an input u of the set, for a (n_u,)."""
        a = _entries("a", a, self.n_u)
        return float(np.maximum(a * self.low, a * self.high).sum())

    def project(self, u: ArrayLike) -> Array:
        """Return the nearest point of the set to u (n_u,), or to each of many u (…, n_u)."""
        points = reals("u", u)
        if points.shape[-1:] != (self.n_u,):
            raise InvalidInputError(f"u: got shape {points.shape}, expected (…, {self.n_u})")
        return np.minimum(np.maximum(points, self.low), self.high)

    def vertices(self) -> Array:
        """Return the corners (2^n_u, n_u); in the plane, counter-clockwise."""
        if self.n_u == 2:
            (x0, y0), (x1, y1) = self.low, self.high
            return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        limits = zip(self.low, self.high, strict=True)
        return np.stack(np.meshgrid(*limits, indexing="ij"), axis=-1).reshape(-1, self.n_u)

    def scaled(self, factor: float) -> "Box":
        """Return the set with every input multiplied by a factor above 0."""
        factor = finite_float("factor", factor, minimum=0.0, exclusive=True)
        return Box(factor * self.low, factor * self.high)

    def to_dict(self) -> dict[str, Any]:
        """Return a plain dict that JSON can hold and :func:`from_dict` reads."""
        return records.to_dict(self, _KINDS)


@dataclass(frozen=True)
class Ball:
    """The disc ``‖u‖ ≤ radius`` in the plane, as the regular polygon inscribed in it.

    The polygon is an inner approximation: every input in it is in the disc. Its sides are at most
    ``radius (1 − cos(π / sides))`` inside of the circle (1.9 % of the radius for 16 sides).

    Args:
        radius: the disc's radius, above 0.
        sides: the polygon's number of sides, from 3 to 64.

    Raises:
        InvalidInputError: on other values.
    """

    radius: float
    sides: int = 16

    def __post_init__(self) -> None:
        radius = finite_float("radius", self.radius, minimum=0.0, exclusive=True)
        object.__setattr__(self, "radius", radius)
        object.__setattr__(self, "sides", count("sides", self.sides, minimum=3, maximum=64))

    @property
    def n_u(self) -> int:
        """The number of inputs, 2."""
        return 2

    def vertices(self) -> Array:
        """Return the corners (sides, 2), counter-clockwise, the first on the x axis."""
        angle = 2.0 * np.pi * np.arange(self.sides) / self.sides
        return self.radius * np.column_stack((np.cos(angle), np.sin(angle)))

    def halfspaces(self) -> tuple[Array, Array]:
        """Return A (sides, 2) and b (sides,) with ``U = {u : A u ≥ b}`` and unit rows."""
        normals, offsets = self._halfspaces
        return normals.copy(), offsets.copy()

    @cached_property
    def _halfspaces(self) -> tuple[Array, Array]:
        """A, the inward normals of the sides, and b of `halfspaces`."""
        angle = 2.0 * np.pi * (np.arange(self.sides) + 0.5) / self.sides
        normals = -np.column_stack((np.cos(angle), np.sin(angle)))
        offsets = np.full(self.sides, -self.radius * np.cos(np.pi / self.sides))
        return normals, offsets

    def contains(self, u: ArrayLike, tolerance: float = 1e-9) -> bool:
        """Return whether u (2,) is in the polygon, or at most `tolerance` outside a side."""
        a, b = self._halfspaces
        tolerance = finite_float("tolerance", tolerance)
        return bool((a @ _entries("u", u, 2) >= b - tolerance).all())

    def support(self, a: Array) -> float:
        """Return the largest a·u of an input u of the polygon, for a (2,)."""
        return float((self.vertices() @ _entries("a", a, 2)).max())

    def project(self, u: ArrayLike) -> Array:
        """Return the point of the polygon that is nearest to u (2,)."""
        point = _entries("u", u, 2)
        if self.contains(point, 0.0):
            return point
        starts = self.vertices()
        sides = np.roll(starts, -1, axis=0) - starts
        shares = np.sum((point - starts) * sides, axis=1) / np.sum(sides**2, axis=1)
        nearest = starts + np.clip(shares, 0.0, 1.0)[:, None] * sides  # on each of the sides
        return nearest[np.argmin(np.sum((nearest - point) ** 2, axis=1))]

    def scaled(self, factor: float) -> "Ball":
        """Return the set with every input multiplied by a factor above 0."""
        factor = finite_float("factor", factor, minimum=0.0, exclusive=True)
        return Ball(factor * self.radius, self.sides)

    def to_dict(self) -> dict[str, Any]:
        """Return a plain dict that JSON can hold and :func:`from_dict` reads."""
        return records.to_dict(self, _KINDS)


InputSet = Box | Ball


def read(name: str, value: Any) -> InputSet:
    """Return an input set: itself, or the box of a bounded space of Gymnasium.

    Args:
        name: the argument's name, for the message.
        value: an input set, or a space with `low`, `high` and `dtype` as `gymnasium.spaces.Box`.

    Raises:
        InvalidInputError: if it is neither, a space of other numbers than floats, or of a subclass
            with methods of its own.
    """
    if isinstance(value, Box | Ball):
        check_not_overridden(name, value, Box, Ball)
        return value
    low, high, dtype = (getattr(value, name, None) for name in ("low", "high", "dtype"))
    if low is None or high is None or not isinstance(dtype, np.dtype) or dtype.char not in "fd":
        raise InvalidInputError(
            f"{name}: got {shown(value)}, expected a Box or a Ball of hcbf_gym.models, or a "
            "bounded Box of Gymnasium with dtype float32 or float64"
        )
    return Box(low, high)


_KINDS: dict[str, type] = {"box": Box, "ball": Ball}


def from_dict(fields: Mapping[str, Any]) -> InputSet:
    """Return the input set that :meth:`Box.to_dict` or :meth:`Ball.to_dict` described.

    Raises:
        UnknownNameError: if `kind` is neither "box" nor "ball".
        InvalidInputError: on missing, unknown or malformed fields.
    """
    return records.from_dict("input set", fields, _KINDS)
