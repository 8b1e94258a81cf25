"""One kink of a sum of one-sided penalties: its minimum, and where the cost falls from there.

The kink of a row is the line ``a·u = b − m`` inside a cell. It leaves the cell at a point A and
enters it at a point B::

              last up ● A ● first down
      n·u > d         │ │         n·u < d        (counter-clockwise from B to A above,
             first up ● B ● last down             from A to B below)
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel
from hcbf_gym.programs.planar.records import Cost, Line, Point
from hcbf_gym.programs.tolerances import OUTWARD, SURELY_MET, THIN

# What is known of a row on the cell: nothing yet, that it is paid for, that it is not.
OPEN, PAID, MET = 0, 1, 2

# Where on the kink its minimum lies.
_INSIDE, _AT_A, _AT_B = 0, 1, 2


class Chord(NamedTuple):
    """The part of a kink that lies in a cell, from A = (px, py) by (dx, dy) to B."""

    px: float
    py: float
    dx: float
    dy: float
    first_up: int
    last_up: int
    first_down: int
    last_down: int


@kernel(error_model="numpy")
def settle(
    cell: Array, count: int, line: Line, own: int, cost: Cost, radius: float
) -> tuple[float, float, int]:
    """Minimise on the kink of one row, and tell where the cost falls from there.

    Args:
        cell: (capacity, 2) the polygon, which the kink crosses.
        count: its number of corners.
        line: the kink.
        own: the row's index.
        cost: the cost; its rows' states are known to be PAID or MET, or OPEN.
        radius: the largest norm of an input.

    Returns:
        The minimiser on the kink; +1 or −1 for the side with n·u above or below d, 0 for neither.
    """
    chord = _chord(cell, count, line)
    t, place = _minimise_along(chord, own, cost, radius)
    x, y = chord.px + t * chord.dx, chord.py + t * chord.dy
    best, side = 0.0, 0
    for sign in (1, -1):
        ex, ey = sign * line.nx, sign * line.ny
        if place != _INSIDE:
            ex, ey = _along_border(cell, count, line, chord, place == _AT_A, sign, radius)
            ex, ey = _unit(ex - x, ey - y)
        slope, _ = slopes(x, y, ex, ey, cost, radius)
        if slope < best:
            best, side = slope, sign
        for k in range(cost.rows.size):
            row = cost.rows[k]
            if k == own or not _kinks_at(row, x, y, radius):
                continue
            ex = -row.ay / row.norm
            ey = row.ax / row.norm
            along = sign * (ex * line.nx + ey * line.ny)
            if abs(along) <= THIN:
                continue
            if along < 0.0:
                ex, ey = -ex, -ey
            if place != _INSIDE and not _enters(cell, count, x, y, ex, ey, THIN * radius):
                continue
            slope, _ = slopes(x, y, ex, ey, cost, radius)
            if slope < best:
                best, side = slope, sign
    return x, y, side


@kernel(error_model="numpy")
def slopes(
    x: float, y: float, dx: float, dy: float, cost: Cost, radius: float
) -> tuple[float, float]:
    """Return half the directional derivatives of the cost at (x, y) towards d and towards −d.

    A row at its kink pays if the direction leads into its violation. Where it has no least slack,
    nothing jumps there, and what little it pays counts: it may hold back a flatter row.
    """
    forward = cost.lambda_u * ((x - cost.ux) * dx + (y - cost.uy) * dy)
    backward = -forward
    for k in range(cost.rows.size):
        row = cost.rows[k]
        if row.state == MET:
            continue
        gain = row.ax * dx + row.ay * dy
        lack = row.b - row.ax * x - row.ay * y
        over = lack - row.least
        rounding = SURELY_MET * (abs(row.b) + row.norm * radius)
        if row.least > 0.0:
            rounding = THIN * radius * (abs(row.ax) + abs(row.ay))
        if row.state == PAID or over > rounding:
            forward -= row.weight * lack * gain
            backward += row.weight * lack * gain
        elif over > -rounding:
            forward -= row.weight * row.least * min(gain, 0.0)
            backward += row.weight * row.least * max(gain, 0.0)
    return forward, backward


@kernel(error_model="numpy")
def _chord(cell: Array, count: int, line: Line) -> Chord:
    """Return where a line that crosses a cell does so."""
    first_up, last_up, first_down, last_down = 0, 0, 0, 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here = line.nx * cell[i, 0] + line.ny * cell[i, 1] - line.d > 0.0
        there = line.nx * cell[j, 0] + line.ny * cell[j, 1] - line.d > 0.0
        if here and not there:
            last_up, first_down = i, j
        if there and not here:
            last_down, first_up = i, j
    px, py = _crossing(cell[last_up], cell[first_down], line)
    qx, qy = _crossing(cell[last_down], cell[first_up], line)
    return Chord(px, py, qx - px, qy - py, first_up, last_up, first_down, last_down)


@kernel(error_model="numpy")
def _crossing(start: Array, end: Array, line: Line) -> Point:
    """Return where the side from `start` to `end` crosses a line."""
    here = line.nx * start[0] + line.ny * start[1] - line.d
    there = line.nx * end[0] + line.ny * end[1] - line.d
    t = here / (here - there)
    return start[0] + t * (end[0] - start[0]), start[1] + t * (end[1] - start[1])


@kernel(error_model="numpy")
def _minimise_along(chord: Chord, own: int, cost: Cost, radius: float) -> tuple[float, int]:
    """Return the minimiser on a chord, from 0 at A to 1 at B, and whether it is one of the two."""
    px, py, dx, dy = chord.px, chord.py, chord.dx, chord.dy
    start, _ = slopes(px, py, dx, dy, cost, radius)
    if start >= 0.0:
        return 0.0, _AT_A
    _, end = slopes(px + dx, py + dy, dx, dy, cost, radius)
    if end >= 0.0:
        return 1.0, _AT_B
    low, high = 0.0, 1.0
    for k in range(cost.rows.size):
        row = cost.rows[k]
        gain = row.ax * dx + row.ay * dy
        if k == own or row.state != OPEN or gain == 0.0:
            continue
        s = (row.b - row.least - row.ax * px - row.ay * py) / gain
        if not low < s < high:
            continue
        forward, backward = slopes(px + s * dx, py + s * dy, dx, dy, cost, radius)
        if forward < 0.0:
            low, start = s, forward
        elif backward < 0.0:
            high, end = s, backward
        else:
            return s, _INSIDE
    # between two neighbouring kinks the slope is a straight line
    return (low + (high - low) * start / (start + end) if start + end < 0.0 else low), _INSIDE


@kernel(error_model="numpy")
def _along_border(
    cell: Array, count: int, line: Line, chord: Chord, at_a: bool, sign: int, radius: float
) -> Point:
    """Return the cell's next corner from A or B on the side `sign` of a kink.

    It is the first whose ``sign n·u`` exceeds ``sign d`` by more than rounding.
    """
    if at_a:
        corner = chord.last_up if sign > 0 else chord.first_down
    else:
        corner = chord.first_up if sign > 0 else chord.last_down
    step = -1 if at_a == (sign > 0) else 1
    for _ in range(count):
        above = sign * (line.nx * cell[corner, 0] + line.ny * cell[corner, 1] - line.d)
        if above > THIN * radius:
            break
        corner = (corner + step) % count
    return cell[corner, 0], cell[corner, 1]


@kernel(error_model="numpy")
def _unit(x: float, y: float) -> Point:
    length = np.hypot(x, y)
    return x / length, y / length


@kernel(error_model="numpy")
def _kinks_at(row: np.record, x: float, y: float, radius: float) -> bool:
    """Return whether the slope of an open row's cost jumps at a point."""
    if row.state != OPEN or row.least == 0.0:
        return False
    above = row.ax * x + row.ay * y - row.b + row.least
    return abs(above) <= THIN * radius * row.norm


@kernel(error_model="numpy")
def _enters(cell: Array, count: int, x: float, y: float, ex: float, ey: float, thin: float) -> bool:
    """Return whether the direction e leads from the border point (x, y) into the cell."""
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        sx, sy = cell[j, 0] - cell[i, 0], cell[j, 1] - cell[i, 1]
        length = np.hypot(sx, sy)
        distance = (sx * (y - cell[i, 1]) - sy * (x - cell[i, 0])) / length
        if distance <= thin and sx * ey - sy * ex < -OUTWARD * length:
            return False
    return True
