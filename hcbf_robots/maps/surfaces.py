"""Fits straight surfaces to the points that a turning beam has met, without cells.

Neighbours in the list are neighbours in sight. Two of them belong to one surface if they are close,
or if the beam meets the line that joins them at no flat angle. Then all between them is taken for
occupied, even where beams between them saw nothing. A chain of such points is cut into straight
pieces until each point is within a tolerance of the best line through its piece.

Sources: the limit of the angle is the breakpoint detector of G. A. Borges and M.-J. Aldon, "Line
extraction in 2D range images for mobile robotics", 2004; the cuts are those of D. H. Douglas and
T. K. Peucker, 1973, with lines of total least squares in the place of chords.
"""

from hcbf_gym import _core
from hcbf_gym.arrays import Array

CLOSE: float = _core.SURFACE_CLOSE
"""Points that are no farther apart always belong to one surface, as no robot fits between [m]."""
EDGE: float = _core.SURFACE_EDGE
"""Length of a piece beyond its outermost points, which gives a single point a width [m]."""


def pieces(points: Array, tolerance: float, depth: float) -> Array:
    """Return the corners (P, 4, 2) of rectangles along the surfaces, counter-clockwise [m].

    The points (k, 2) are in the sensor's axes, in the order in which its beam turns, and within the
    tolerance of a piece. The rectangles extend by the depth away from the sensor [m].
    """
    return _core.surface_pieces(points, tolerance, depth)
