"""Nav2's footprints: the circle that contains a robot's outline."""

import ast
import math

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.errors import InvalidInputError, as_array, finite_array, shown

LONGEST_TEXT = 10_000  # of a footprint [characters]
LARGEST_COORDINATE = 50.0  # of a corner [m]; greater numbers are millimetres
LEAST_WIDTH = 1e-3  # of an outline [m]; corners that are no farther apart count as one


def reach(footprint: str | ArrayLike) -> float:
    """Return the radius of the smallest circle around (0, 0) that contains a footprint [m].

    Args:
        footprint: corners ((x, y), …) in the axes of the robot, whose axle or centre is (0, 0), in
            any order; or Nav2's text of them, ``"[[0.2, 0.1], …]"`` [m].

    Raises:
        InvalidInputError: if it is no outline around (0, 0).
    """
    corners = _corners_in(footprint) if isinstance(footprint, str) else footprint
    array = as_array("footprint", corners)
    points = finite_array("footprint", array, (None, 2), largest=LARGEST_COORDINATE)
    points = points[np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1) > LEAST_WIDTH]
    if len(points) < 3:
        raise InvalidInputError(
            f"footprint: got {len(points)} different corners, expected at least 3 pairs (x, y) "
            "[m]; a round robot has a reach instead"
        )
    centred = points - points.mean(axis=0)
    narrowest_direction = np.linalg.svd(centred)[2][1]
    width = np.ptp(centred @ narrowest_direction)
    if width < LEAST_WIDTH:
        raise InvalidInputError(
            f"footprint: got an outline {width:.3g} m wide, expected at least {LEAST_WIDTH:g} m"
        )
    angles = np.sort(np.arctan2(points[:, 1], points[:, 0]))
    gaps = np.diff(angles, append=angles[0] + math.tau)
    if gaps.max() > math.pi + 1e-9:  # then a half-plane has no corner
        raise InvalidInputError(
            f"footprint: got {shown(points.tolist())}, all on one side of (0, 0), expected corners "
            "counted from the axle or the centre that turns"
        )
    return float(np.linalg.norm(points, axis=1).max())


def _corners_in(text: str) -> object:
    """Return the corners in Nav2's text, unchecked; None of a text that is too long."""
    try:
        return ast.literal_eval(text.strip()) if len(text) <= LONGEST_TEXT else None
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        raise InvalidInputError(
            f"footprint: got the text {shown(text)}, expected Nav2's '[[x, y], [x, y], …]' with "
            "finite numbers [m]"
        ) from None
