"""Straight surfaces through the points that a turning beam has met, without cells.

Neighbours in the list are neighbours in sight. Two of them see one surface where they are close,
or where the beam meets what joins them at no flat angle: then all that lies between them is taken
for occupied, also where beams between them saw nothing. A chain of such points is cut into straight
pieces until each point lies within a tolerance of the line that fits its piece best.

Sources: the limit of the angle is the breakpoint detector of G. A. Borges and M.-J. Aldon, "Line
extraction in 2D range images for mobile robotics", 2004; the cuts are those of D. H. Douglas and
T. K. Peucker, 1973, with lines of total least squares in the place of chords.
"""

from hcbf_gym import _core
from hcbf_gym.arrays import Array

CLOSE: float = _core.SURFACE_CLOSE
"""Points that are no farther apart belong together however they lie [m], as no robot passes."""
EDGE: float = _core.SURFACE_EDGE
"""By how much pieces reach beyond their outermost points, so that a point alone has a width [m]."""


def pieces(points: Array, tolerance: float, depth: float) -> Array:
    """Return (P, 4, 2) rectangles, counter-clockwise, along the surfaces of points (k, 2) [m].

    The points are in the order in which a beam turns, and within the tolerance of a piece, which
    reaches away from the sensor by its depth.
    """
    return _core.surface_pieces(points, tolerance, depth)
