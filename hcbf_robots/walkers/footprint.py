"""Nav2's footprints: the circle that holds a robot's outline."""

import ast
import math

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.errors import InvalidInputError, as_array, finite_array, shown

LONGEST_TEXT = 10_000  # characters of a footprint
LARGEST = 50.0  # how far a robot reaches at most [m]: beyond, the numbers are millimetres
THINNEST = 1e-3  # width of an outline, and the distance of its corners [m]


def reach(footprint: str | ArrayLike) -> float:
    """Return the radius of the smallest circle around (0, 0) that holds a footprint [m].

    Args:
        footprint: corners ((x, y), …) in the axes of the robot, whose axle or centre is (0, 0), in
            any order; or Nav2's text of them, ``"[[0.2, 0.1], …]"`` [m].

    Raises:
        InvalidInputError: if it is no outline around (0, 0).
    """
    given = _read(footprint) if isinstance(footprint, str) else footprint
    points = finite_array("footprint", as_array("footprint", given), (None, 2), largest=LARGEST)
    points = points[np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1) > THINNEST]
    if len(points) < 3:
        raise InvalidInputError(
            f"footprint: got {len(points)} different corners, expected at least 3 pairs (x, y) "
            "[m]; a round robot has a reach instead"
        )
    centred = points - points.mean(axis=0)
    width = np.ptp(centred @ np.linalg.svd(centred)[2][1])
    if width < THINNEST:
        raise InvalidInputError(
            f"footprint: got an outline {width:.3g} m wide, expected at least {THINNEST:g} m"
        )
    angles = np.sort(np.arctan2(points[:, 1], points[:, 0]))
    if np.diff(angles, append=angles[0] + math.tau).max() > math.pi + 1e-9:
        raise InvalidInputError(
            f"footprint: got {shown(points.tolist())}, all on one side of (0, 0), expected corners "
            "counted from the axle or the centre that turns"
        )
    return float(np.linalg.norm(points, axis=1).max())


def _read(text: str) -> object:
    """Return the corners in Nav2's text."""
    try:
        return ast.literal_eval(text.strip()) if len(text) <= LONGEST_TEXT else None
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        raise InvalidInputError(
            f"footprint: got the text {shown(text)}, expected Nav2's '[[x, y], [x, y], …]' with "
            "finite numbers [m]"
        ) from None
