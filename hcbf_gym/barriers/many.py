"""Many barriers of one shape and one rank, given as an array: what a scan or a tracker returns."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import check_name
from hcbf_gym.errors import InvalidInputError, as_array, choose, finite_array
from hcbf_gym.models.constants import FARTHEST

Array = NDArray[np.float64]


class Shapes:
    """k barriers of one shape, which stand in a list of barriers as one entry.

    They become rows without an object of their own, so that a scan of 360 points costs some
    microseconds. For two-input filters of the planar double integrator.

    Args:
        name: what messages call them.
        priority: of all of them; 1 is the highest and strict.
        shape: "disc" (values (k, 3): centre and radius [m]), "half-plane" ((k, 3): unit normal into
            the allowed side, and n·p on the wall [m]) or "convex-polygon" ((k, v, 2): v corners
            [m], counter-clockwise).
        values: k of them; copied.
        velocity: (2,) or (k, 2) of their frames [m/s].

    Raises:
        UnknownNameError: if there is no such shape.
        InvalidInputError: if a number is not finite or out of range, or the array of another shape.

    Attributes:
        kind: which kernel evaluates them, see `layout`.
        parameters: (k, WIDTH) what it reads.

    Examples:
        >>> from hcbf_gym import barriers
        >>> scan = barriers.Shapes("scan", 1, "disc", [[1.0, 0.0, 0.1], [1.0, 0.2, 0.1]])
        >>> len(scan)
        2
    """

    reads_position = True

    def __init__(
        self,
        name: str,
        priority: int,
        shape: str,
        values: ArrayLike,
        velocity: ArrayLike = (0.0, 0.0),
    ):
        check_name(name, priority)
        self.name, self.priority = name, int(priority)
        self.kind, write = choose("shape", shape, _SHAPES)
        given = as_array(f"{name}: values", values)
        if given.size == 0:
            given = np.zeros((0, 3, 2) if self.kind == layout.CONVEX_POLYGON else (0, 3))
        self.parameters = np.zeros((len(given) if given.ndim else 0, layout.WIDTH))
        write(f"{name}: {shape}", given, self.parameters)
        wanted = (2,) if as_array(f"{name}: velocity", velocity).ndim == 1 else (len(self), 2)
        moving = finite_array(f"{name}: velocity", velocity, wanted, largest=FARTHEST)
        self.parameters[:, [layout.VELOCITY_X, layout.VELOCITY_Y]] = moving
        self.parameters.flags.writeable = False

    def __len__(self) -> int:
        """Return k."""
        return len(self.parameters)


def _write_discs(name: str, values: Array, parameters: Array) -> None:
    discs = finite_array(name, values, (None, 3), largest=FARTHEST)
    if (discs[:, 2] <= 0.0).any():
        raise InvalidInputError(f"{name}: got radius {discs[:, 2].min()}, expected > 0")
    parameters[:, [layout.CENTER_X, layout.CENTER_Y, layout.RADIUS]] = discs


def _write_half_planes(name: str, values: Array, parameters: Array) -> None:
    walls = finite_array(name, values, (None, 3), largest=FARTHEST)
    length = np.hypot(walls[:, 0], walls[:, 1])
    if (np.abs(length - 1.0) > 1e-6).any():
        raise InvalidInputError(f"{name}: got normals of length {length.tolist()}, expected 1")
    walls[:, :2] /= length[:, None]
    parameters[:, [layout.NORMAL_X, layout.NORMAL_Y, layout.OFFSET]] = walls


def _write_polygons(name: str, values: Array, parameters: Array) -> None:
    corners = finite_array(name, values, (None, None, 2), largest=FARTHEST)
    count = corners.shape[1]
    if not 3 <= count <= layout.MAX_VERTICES:
        raise InvalidInputError(f"{name}: got {count} corners, expected 3 to {layout.MAX_VERTICES}")
    edges = np.roll(corners, -1, axis=1) - corners
    following = np.roll(edges, -1, axis=1)
    turns = edges[..., 0] * following[..., 1] - edges[..., 1] * following[..., 0]
    winding = np.arctan2(turns, np.sum(edges * following, axis=2)).sum(axis=1)
    if (turns <= 0.0).any() or (winding > 2.5 * np.pi).any():
        raise InvalidInputError(
            f"{name}: got corners that are no strictly convex polygons, counter-clockwise"
        )
    parameters[:, layout.VERTEX_COUNT] = count
    first = layout.FIRST_VERTEX
    parameters[:, first : first + 2 * count] = corners.reshape(len(corners), 2 * count)


_SHAPES: dict[str, tuple[int, Callable[[str, Any, Array], None]]] = {
    "disc": (layout.DISC, _write_discs),
    "half-plane": (layout.HALF_PLANE, _write_half_planes),
    "convex-polygon": (layout.CONVEX_POLYGON, _write_polygons),
}
