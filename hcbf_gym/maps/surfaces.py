"""Straight surfaces through the points that a turning beam has met, without cells.

Neighbours in the list are neighbours in sight. Two of them see one surface where they are close,
or where the beam meets what joins them at no flat angle: then all that lies between them is taken
for occupied, also where beams between them saw nothing. A chain of such points is cut into straight
pieces until each point lies within a tolerance of the line that fits its piece best.

Sources: the limit of the angle is the breakpoint detector of G. A. Borges and M.-J. Aldon, "Line
extraction in 2D range images for mobile robotics", 2004; the cuts are those of D. H. Douglas and
T. K. Peucker, 1973, with lines of total least squares in the place of chords.
"""

import math

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.compilation import kernel

FLATTEST = math.sin(math.radians(10.0))
"""Of the sine of the angle between a beam and a surface that it is believed to have met."""
WIDEST = math.radians(10.0)
"""Of the angle between two beams that may see one surface: at 1.5 m they are 26 cm apart."""
CLOSE = 0.05
"""Points that are no farther apart belong together however they lie [m], as no robot passes."""
EDGE = 1e-3
"""By how much pieces reach beyond their outermost points, so that a point alone has a width [m]."""
ROUNDING = 1e-6
"""By how much they reach towards the sensor [m]: more than the rounding of any distance."""


def pieces(points: Array, tolerance: float, depth: float) -> Array:
    """Return (P, 4, 2) rectangles, counter-clockwise, along the surfaces that points show.

    Args:
        points: (k, 2) in the sensor's axes [m], in the order in which a beam turns.
        tolerance: how far from a piece its points may lie [m].
        depth: how far pieces reach away from the sensor, where nobody has seen anything [m].
    """
    return _pieces(np.ascontiguousarray(points), tolerance, depth)


@kernel(error_model="numpy")
def _pieces(points: Array, tolerance: float, depth: float) -> Array:
    k = len(points)
    out = np.empty((2 * k, 4, 2))
    if k == 0:
        return out
    joined = _joined(points, tolerance)
    start = 0
    for i in range(k):
        if not joined[i]:
            start = (i + 1) % k
            break
    found, first = 0, 0
    for last in range(k):
        if joined[(start + last) % k] and last < k - 1:
            continue
        closed = joined[(start + last) % k] and k > 2  # all of it is one ring
        chain = np.empty((last - first + 1 + closed, 2))
        for n in range(len(chain)):
            chain[n] = points[(start + first + n) % k]
        found = _cut(chain, tolerance, depth, out, found)
        first = last + 1
    return out[:found].copy()


@kernel(error_model="numpy")
def _joined(points: Array, tolerance: float) -> Mask:
    """Return (k,) whether a point and the next one, after the last the first, see one surface."""
    k = len(points)
    joined = np.zeros(k, dtype=np.bool_)
    for i in range(k):
        (px, py), (qx, qy) = points[i], points[(i + 1) % k]
        apart = np.hypot(qx - px, qy - py)
        turn = np.arctan2(abs(px * qy - py * qx), px * qx + py * qy)
        farther = max(np.hypot(px, py), np.hypot(qx, qy))
        steep = abs(px * qy - py * qx) >= FLATTEST * apart * farther
        joined[i] = apart <= CLOSE + 2.0 * tolerance or (turn <= WIDEST and steep)
    return joined


@kernel(error_model="numpy")
def _cut(chain: Array, tolerance: float, depth: float, out: Array, found: int) -> int:
    """Write the pieces of a chain (n, 2) from out[found] on; return how many there are then."""
    waiting = [(0, len(chain) - 1)]
    while len(waiting) > 0:
        i, j = waiting.pop()
        mean_x, mean_y, dx, dy = _line(chain, i, j)
        off = 0.0
        low, high = np.inf, -np.inf
        for n in range(i, j + 1):
            x, y = chain[n, 0] - mean_x, chain[n, 1] - mean_y
            off = max(off, abs(dx * y - dy * x))
            low, high = min(low, dx * x + dy * y), max(high, dx * x + dy * y)
        if off > tolerance and j > i + 1:
            n = _farthest(chain, i, j)
            waiting.append((i, n))
            waiting.append((n, j))
            continue
        if dx * mean_y - dy * mean_x < 0.0:  # the left of the line shall lie farther away
            dx, dy, low, high = -dx, -dy, -high, -low
        near_x, near_y = mean_x + ROUNDING * dy, mean_y - ROUNDING * dx
        ax, ay = near_x + (low - EDGE) * dx, near_y + (low - EDGE) * dy
        bx, by = near_x + (high + EDGE) * dx, near_y + (high + EDGE) * dy
        out[found, 0, 0], out[found, 0, 1] = ax, ay
        out[found, 1, 0], out[found, 1, 1] = bx, by
        out[found, 2, 0], out[found, 2, 1] = bx - depth * dy, by + depth * dx
        out[found, 3, 0], out[found, 3, 1] = ax - depth * dy, ay + depth * dx
        found += 1
    return found


@kernel(error_model="numpy")
def _line(chain: Array, i: int, j: int) -> tuple[float, float, float, float]:
    """Return a point of the line that fits points i to j best, and its direction.

    Where they are one point, it lies across the beam.
    """
    mean_x = mean_y = 0.0
    for n in range(i, j + 1):
        mean_x += chain[n, 0] / (j - i + 1)
        mean_y += chain[n, 1] / (j - i + 1)
    xx = xy = yy = 0.0
    for n in range(i, j + 1):
        x, y = chain[n, 0] - mean_x, chain[n, 1] - mean_y
        xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
    across = np.arctan2(mean_x, -mean_y)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy) if xx + yy > 0.0 else across
    return mean_x, mean_y, np.cos(angle), np.sin(angle)


@kernel(error_model="numpy")
def _farthest(chain: Array, i: int, j: int) -> int:
    """Return which point between i and j lies farthest from their chord, or from both as one."""
    ax, ay = chain[i]
    ex, ey = chain[j, 0] - ax, chain[j, 1] - ay
    best, at = -1.0, i + 1
    for n in range(i + 1, j):
        x, y = chain[n, 0] - ax, chain[n, 1] - ay
        off = abs(ex * y - ey * x) if ex != 0.0 or ey != 0.0 else np.hypot(x, y)
        if off > best:
            best, at = off, n
    return at
