"""The built-in barriers: half-plane, disc, ellipse, convex polygon, speed limit.

Each is a function H of the position seen from its own, possibly moving, frame, and also exists
compiled in `kernels`, tested against the readable form here.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.barriers.barrier import Barrier, Core, Jet, Pair, PlanarBarrier
from hcbf_gym.barriers.kernels import TINY
from hcbf_gym.barriers.layout import MAX_VERTICES
from hcbf_gym.errors import InvalidInputError, finite_array, finite_float
from hcbf_gym.models.constants import FARTHEST

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HalfPlane(PlanarBarrier):
    """The allowed side of a straight wall, ``h = n·p − offset``.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        normal: (2,) unit vector that points into the allowed side.
        offset: n·p on the wall [m].

    Raises:
        InvalidInputError: if the normal is not a unit vector or a number is not finite.
    """

    normal: Pair = (1.0, 0.0)
    offset: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        normal = finite_array(f"{self.name}: normal", self.normal, (2,))
        length = float(np.linalg.norm(normal))
        if abs(length - 1.0) > 1e-6:
            raise InvalidInputError(f"{self.name}: normal: got length {length}, expected 1")
        if abs(length - 1.0) > 1e-12:
            normal = normal / length
        object.__setattr__(self, "normal", tuple(normal.tolist()))
        object.__setattr__(
            self,
            "offset",
            finite_float(f"{self.name}: offset", self.offset, minimum=-FARTHEST, maximum=FARTHEST),
        )

    def planar_jet(self, q: Array) -> tuple[float, Array, Array]:
        """Return H, ∇H and ∇²H."""
        normal = np.array(self.normal)
        return float(normal @ q - self.offset), normal, np.zeros((2, 2))

    def core(self, q: Array, reach: float) -> Core:
        """Return a core infinitely far away: ∇H never turns."""
        return Core(np.inf, np.inf, False)


@dataclass(frozen=True)
class Disc(PlanarBarrier):
    """The outside of a disc, ``h = ‖p − c‖ − r``.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        center: (2,) c at t = 0 [m].
        radius: r [m], positive.
        velocity: (2,) of the centre [m/s].

    Raises:
        InvalidInputError: if the radius is not positive or a number is not finite.

    Source: section IV-A of the paper, h₃ and h₄.
    """

    center: Pair = (0.0, 0.0)
    radius: float = 1.0
    velocity: Pair = (0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        _set_pairs(self, "center", "velocity")
        radius = finite_float(
            f"{self.name}: radius", self.radius, minimum=0.0, maximum=FARTHEST, exclusive=True
        )
        object.__setattr__(self, "radius", radius)

    def planar_jet(self, q: Array) -> tuple[float, Array, Array]:
        """Return H, ∇H and ∇²H; at the very centre the gradient is taken along +x."""
        distance, direction, curvature = _norm_jet(q - np.array(self.center))
        return distance - self.radius, direction, curvature

    def core(self, q: Array, reach: float) -> Core:
        """Return the centre as the core."""
        return Core(self.planar_jet(q)[0] + self.radius, self.radius, True)


@dataclass(frozen=True)
class Ellipse(PlanarBarrier):
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

    def __post_init__(self) -> None:
        super().__post_init__()
        _set_pairs(self, "center", "velocity", "semi_axes")
        for axis in self.semi_axes:
            finite_float(f"{self.name}: semi_axes", axis, minimum=0.0, exclusive=True)
        object.__setattr__(self, "angle", finite_float(f"{self.name}: angle", self.angle))

    @property
    def scaling(self) -> Array:
        """(2, 2) the map A from p − c to z."""
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        return np.diag(1.0 / np.array(self.semi_axes)) @ np.array([[cos, sin], [-sin, cos]])

    def planar_jet(self, q: Array) -> tuple[float, Array, Array]:
        """Return H, ∇H and ∇²H; at the very centre the gradient is taken along the first axis."""
        scaling, scale = self.scaling, min(self.semi_axes)
        norm, direction, curvature = _norm_jet(scaling @ (q - np.array(self.center)))
        return (
            scale * (norm - 1.0),
            scale * scaling.T @ direction,
            scale * scaling.T @ curvature @ scaling,
        )

    def core(self, q: Array, reach: float) -> Core:
        """Return the centre as the core: shortened along its long axis, an ellipse is a disc.

        In the coordinates min(a, b) z, which shorten every way, it is a disc of radius min(a, b).
        """
        radius = min(self.semi_axes)
        return Core(self.planar_jet(q)[0] + radius, radius, True)


@dataclass(frozen=True)
class ConvexPolygon(PlanarBarrier):
    """The outside of a convex polygon: h is the signed distance to it.

    Outside, h is continuously differentiable (its curvature jumps where the nearest point passes
    from an edge to a corner); inside, it is the depth below the nearest edge.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        vertices: (k, 2) corners [m], counter-clockwise, 3 ≤ k ≤ 8, strictly convex.
        velocity: (2,) of the polygon [m/s].

    Raises:
        InvalidInputError: if the corners are too few, too many, clockwise or not strictly convex.
    """

    vertices: tuple[Pair, ...] = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
    velocity: Pair = (0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        _set_pairs(self, "velocity")
        corners = finite_array(f"{self.name}: vertices", self.vertices, (None, 2), largest=FARTHEST)
        if not 3 <= len(corners) <= MAX_VERTICES:
            raise InvalidInputError(
                f"{self.name}: vertices: got {len(corners)}, expected 3 to {MAX_VERTICES}"
            )
        edges = np.roll(corners, -1, axis=0) - corners
        following = np.roll(edges, -1, axis=0)
        turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
        winding = np.arctan2(turns, np.sum(edges * following, axis=1)).sum()
        if (turns <= 0.0).any() or winding > 2.5 * np.pi:
            raise InvalidInputError(
                f"{self.name}: vertices: got {corners.tolist()}, "
                "expected the corners of a strictly convex polygon, counter-clockwise"
            )
        object.__setattr__(self, "vertices", tuple(tuple(c) for c in corners.tolist()))

    def planar_jet(self, q: Array) -> tuple[float, Array, Array]:
        """Return H, ∇H and ∇²H."""
        corners = np.array(self.vertices)
        edges = np.roll(corners, -1, axis=0) - corners
        lengths = np.linalg.norm(edges, axis=1)
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / lengths[:, None]
        heights = np.sum(normals * (q - corners), axis=1)
        nearest = int(np.argmax(heights))
        along = np.clip(np.sum((q - corners) * edges, axis=1) / lengths**2, 0.0, 1.0)
        offsets = q - (corners + along[:, None] * edges)
        closest = int(np.argmin(np.linalg.norm(offsets, axis=1)))
        distance, direction, curvature = _norm_jet(offsets[closest])
        if heights[nearest] <= 0.0 or distance < TINY:
            return float(heights[nearest]), normals[nearest], np.zeros((2, 2))
        if 0.0 < along[closest] < 1.0:
            return distance, normals[closest], np.zeros((2, 2))
        return distance, direction, curvature

    def core(self, q: Array, reach: float) -> Core:
        """Return nothing as the core where one edge stays the nearest, else a corner, else all.

        Inside, the nearest edge is taken for the region: no bound is known where it changes.
        """
        h = self.planar_jet(q)[0]
        if h <= 0.0:
            return Core(np.inf, 0.0, False)
        corners = np.array(self.vertices)
        edges = np.roll(corners, -1, axis=0) - corners
        lengths = np.linalg.norm(edges, axis=1)
        along = np.sum((q - corners) * edges, axis=1) / lengths
        above = edges[:, 1] * (q - corners)[:, 0] - edges[:, 0] * (q - corners)[:, 1] > 0.0
        if (above & (along >= reach) & (along <= lengths - reach)).any():
            return Core(np.inf, 0.0, False)
        beyond = np.roll(along - lengths, 1)  # past the end of the edge before
        return Core(h, 0.0, bool(((beyond >= reach) & (along <= -reach)).any()))


@dataclass(frozen=True)
class SpeedLimit(Barrier):
    """A cap on the speed of a second-order model, ``h = (v_max² − ‖v‖²) / (2 v_max)``.

    Smooth everywhere, and equal to v_max − ‖v‖ [m/s] to first order at the limit.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict.
        v_max: [m/s], positive.
        margin: what the row reserves of h [m/s]: a body sways around its model's speed.

    Raises:
        InvalidInputError: if v_max is not positive or the margin is not in [0, v_max).
    """

    v_max: float = 1.0
    margin: float = 0.0
    reads_position: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        v_max = finite_float(
            f"{self.name}: v_max", self.v_max, minimum=0.0, maximum=FARTHEST, exclusive=True
        )
        margin = finite_float(f"{self.name}: margin", self.margin, minimum=0.0)
        if margin >= v_max:
            raise InvalidInputError(f"{self.name}: margin: got {margin}, expected below {v_max}")
        object.__setattr__(self, "v_max", v_max)
        object.__setattr__(self, "margin", margin)

    def jet(self, x: Array, t: float = 0.0) -> Jet:
        """Return h and its derivatives."""
        velocity = x[2:4]
        gradient, hessian = np.zeros(len(x)), np.zeros((len(x),) * 2)
        gradient[2:4] = -velocity / self.v_max
        hessian[2:4, 2:4] = -np.eye(2) / self.v_max
        h = (self.v_max**2 - velocity @ velocity) / (2.0 * self.v_max)
        return Jet(float(h), gradient, hessian, 0.0, np.zeros(len(x)), 0.0)


def _norm_jet(r: Array) -> tuple[float, Array, Array]:
    """Return ‖r‖, its gradient and its Hessian; at r = 0 the direction is taken along +x."""
    distance = float(np.linalg.norm(r))
    if distance < TINY:
        return distance, np.array([1.0, 0.0]), np.zeros((2, 2))
    direction = r / distance
    return distance, direction, (np.eye(2) - np.outer(direction, direction)) / distance


def _set_pairs(barrier: Barrier, *names: str) -> None:
    for name in names:
        values = getattr(barrier, name)
        pair = finite_array(f"{barrier.name}: {name}", values, (2,), largest=FARTHEST)
        object.__setattr__(barrier, name, tuple(pair.tolist()))
