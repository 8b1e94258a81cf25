"""Nav2's footprints: the outline of a robot, and the circle that stands for it."""

import ast
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, as_array, finite_array, shown

LONGEST_TEXT = 10_000
"""Characters of a footprint."""
LARGEST = 50.0
"""How far a robot reaches at most [m]: beyond, the numbers are millimetres."""
THINNEST = 1e-3
"""Width of an outline that is one [m]."""
SAME = 1e-3
"""Corners that are nearer are one, as where an outline is closed [m]."""
MOST_CORNERS = 200
"""Each edge is compared with every other."""


def reach(footprint: str | ArrayLike) -> float:
    """Return the radius of the smallest circle around (0, 0) that holds a footprint [m].

    Args:
        footprint: corners ((x, y), …) in the axes of the robot, whose axle or centre is (0, 0),
            in either direction round it; or Nav2's text of them, ``"[[0.2, 0.1], …]"`` [m].

    Raises:
        InvalidInputError: if it is no outline of a robot that holds (0, 0).
    """
    return float(np.linalg.norm(corners(footprint), axis=1).max())


def corners(footprint: str | ArrayLike) -> Array:
    """Return the corners (k, 2) of a footprint, none twice in a row [m]; see `reach`.

    Raises:
        InvalidInputError: if it is no outline of a robot that holds (0, 0).
    """
    given = _read(footprint) if isinstance(footprint, str) else footprint
    points = finite_array("footprint", as_array("footprint", given), (None, 2), largest=LARGEST)
    points = points[np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1) > SAME]
    if not 3 <= len(points) <= MOST_CORNERS:
        raise InvalidInputError(
            f"footprint: got {len(points)} different corners, expected 3 to {MOST_CORNERS} pairs "
            "(x, y) [m]; a round robot has a reach instead"
        )
    ahead = np.roll(points, -1, axis=0)
    spread = np.linalg.svd(points - points.mean(axis=0))
    width = np.ptp((points - points.mean(axis=0)) @ spread[2][1])
    if width < THINNEST:
        raise InvalidInputError(
            f"footprint: got an outline {width:.3g} m wide, expected at least {THINNEST:g} m"
        )
    for i, j in _crossings(points, ahead):
        raise InvalidInputError(
            f"footprint: the edges from {points[i].tolist()} and from {points[j].tolist()} meet, "
            "expected an outline that does not cross itself: the corners in their order round it"
        )
    if not _holds_origin(points, ahead):
        raise InvalidInputError(
            f"footprint: got {shown(points.tolist())}, which does not hold (0, 0), expected "
            "corners counted from the axle or the centre that turns"
        )
    return points


def _read(text: str) -> Any:
    """Return what Nav2's text says.

    Raises:
        InvalidInputError: if it is none.
    """
    try:
        return ast.literal_eval(text.strip()) if len(text) <= LONGEST_TEXT else None
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        raise InvalidInputError(
            f"footprint: got the text {shown(text)}, expected Nav2's '[[x, y], [x, y], …]' with "
            "finite numbers [m]"
        ) from None


def _crossings(points: Array, ahead: Array) -> list[tuple[int, int]]:
    """Return the pairs of edges that share more than the corner between neighbours."""
    count = len(points)
    found = []
    for i, j in combinations(range(count), 2):
        p, q, r, s = points[i], ahead[i], points[j], ahead[j]
        if (i + 1) % count == j or (j + 1) % count == i:
            shared, one, other = (q, p, s) if (i + 1) % count == j else (p, q, r)
            folded = _side(shared, one, other) == 0.0 and (one - shared) @ (other - shared) > 0.0
            if folded:
                found.append((i, j))
        elif _meet(p, q, r, s):
            found.append((i, j))
    return found


def _side(a: Array, b: Array, c: Array) -> float:
    """Return on which side of a to b the point c lies: 1 left, −1 right, 0 on the line."""
    (abx, aby), (acx, acy) = (b - a).tolist(), (c - a).tolist()
    return float(np.sign(abx * acy - aby * acx))


def _meet(p: Array, q: Array, r: Array, s: Array) -> bool:
    """Return whether the segments p to q and r to s have a point in common."""
    if (np.maximum(p, q) < np.minimum(r, s)).any() or (np.maximum(r, s) < np.minimum(p, q)).any():
        return False
    return _side(p, q, r) * _side(p, q, s) <= 0.0 and _side(r, s, p) * _side(r, s, q) <= 0.0


def _holds_origin(points: Array, ahead: Array) -> bool:
    """Return whether (0, 0) lies in a polygon or on its border."""
    zero, inside = np.zeros(2), False
    for a, b in zip(points, ahead, strict=True):
        if _side(a, b, zero) == 0.0 and a @ b <= 0.0:
            return True
        if (a[1] > 0.0) != (b[1] > 0.0):
            inside ^= (_side(a, b, zero) > 0.0) == (b[1] > a[1])
    return inside
