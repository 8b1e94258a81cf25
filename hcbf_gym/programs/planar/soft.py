"""The minimum over a polygon of one-sided penalties, ``λ_u ‖u − u*‖² + Σ w_k max(m_k, v_k)²``.

``v_k = b_k − a_k·u`` is row k's violation, m_k ≥ 0 the least slack it pays for. The cost is convex
and quadratic on each cell that the kinks ``v_k = m_k`` cut out of the polygon. The minimum on a
kink tells on which side of it the minimum of the whole lies: the polygon is cut down, kink by kink,
to one cell, where the cost is one quadratic.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.programs.planar.polygon import THIN, ZERO_GRADIENT, add_row, cut, minimise, slice_at

Array = NDArray[np.float64]

# A violation whose share of the penalty's root is smaller is the rounding of steeper rows.
NEGLIGIBLE = 1e-11

# What is known of a row on the cell: nothing yet, that it is paid for, that it is not.
_OPEN, _PAID, _MET = 0, 1, 2


@njit(cache=True)
def soft_minimum(
    corners: Array,
    count: int,
    a: Array,
    b: Array,
    least: Array,
    weight: Array,
    lambda_u: float,
    ux: float,
    uy: float,
    radius: float,
    cell: Array,
    scratch: Array,
    scratch_cut: Array,
    state: NDArray[np.int64],
) -> tuple[float, float]:
    """Return a minimiser over the polygon; rows of weight 0 drop out.

    Args:
        corners: (capacity, 2) the polygon, left as it is.
        count: its number of corners.
        a: (m, 2) the rows' gradients.
        b: (m,) their bounds.
        least: (m,) the least slack m_k that each pays for.
        weight: (m,) w_k ≥ 0.
        lambda_u: λ_u ≥ 0; where it is 0 the minimiser need not be the one nearest u*.
        ux: x component of u*.
        uy: y component of u*.
        radius: the largest norm of an input.
        cell: (capacity, 2) working space.
        scratch: (capacity, 2) working space.
        scratch_cut: (capacity, 2) working space.
        state: (m,) working space.
    """
    x, y, found = _newton(
        corners, count, a, b, least, weight, lambda_u, ux, uy, radius, scratch, scratch_cut, state
    )
    if found:
        return x, y
    thin = THIN * radius
    cell[:count] = corners[:count]
    for k in range(b.size):
        norm = np.hypot(a[k, 0], a[k, 1])
        if weight[k] == 0.0 or norm <= ZERO_GRADIENT:
            state[k] = _MET
            continue
        state[k] = _OPEN
    while True:
        chosen, depth = -1, 0.0
        for k in range(b.size):
            if state[k] != _OPEN:
                continue
            norm = np.hypot(a[k, 0], a[k, 1])
            nx, ny, d = a[k, 0] / norm, a[k, 1] / norm, (b[k] - least[k]) / norm
            lowest, highest = np.inf, -np.inf
            for i in range(count):
                value = nx * cell[i, 0] + ny * cell[i, 1]
                lowest, highest = min(lowest, value), max(highest, value)
            if lowest >= d - thin:
                state[k] = _MET
            elif highest <= d + thin:
                state[k] = _PAID
            elif min(d - lowest, highest - d) > depth:  # the kink that halves the cell best
                chosen, depth = k, min(d - lowest, highest - d)
        if chosen < 0:
            break
        k = chosen
        norm = np.hypot(a[k, 0], a[k, 1])
        nx, ny, d = a[k, 0] / norm, a[k, 1] / norm, (b[k] - least[k]) / norm
        x, y, side = _settle(
            cell, count, nx, ny, d, k, a, b, least, weight, lambda_u, ux, uy, radius, state
        )
        if side == 0:
            return x, y
        state[k] = _MET if side > 0 else _PAID
        count = cut(cell, count, side * nx, side * ny, side * d, radius, scratch)
    root = np.sqrt(lambda_u)
    factor = (root, 0.0, root, root * ux, root * uy)
    for k in range(b.size):
        if state[k] == _PAID:
            root = np.sqrt(weight[k])
            factor = add_row(factor, root * a[k, 0], root * a[k, 1], root * b[k])
    return minimise(cell, count, factor, ux, uy, radius, scratch, scratch_cut)


@njit(cache=True)
def _newton(
    corners: Array,
    count: int,
    a: Array,
    b: Array,
    least: Array,
    weight: Array,
    lambda_u: float,
    ux: float,
    uy: float,
    radius: float,
    scratch: Array,
    scratch_cut: Array,
    state: NDArray[np.int64],
) -> tuple[float, float, bool]:
    """Guess which rows pay, minimise with those, and try again with those that then do.

    Without least slacks the cost has a continuous gradient: a point that minimises the quadratic of
    just the rows that it violates minimises the whole.

    Returns:
        The minimiser, and whether it was found within a few rounds.
    """
    if least.any():
        return 0.0, 0.0, False
    x, y = corners[0]
    for i in range(1, count):
        x, y = x + corners[i, 0], y + corners[i, 1]
    x, y = x / count, y / count
    for attempt in range(8):
        agrees = attempt > 0
        root = np.sqrt(lambda_u)
        factor = (root, 0.0, root, root * ux, root * uy)
        for k in range(b.size):
            norm = np.hypot(a[k, 0], a[k, 1])
            if weight[k] == 0.0 or norm <= ZERO_GRADIENT:
                state[k] = _MET
                continue
            lack = b[k] - a[k, 0] * x - a[k, 1] * y
            # what seems to pay next to its kink may be there to hold back a flatter row
            least_paid, most_met = 1e-6 * norm * radius, 1e-14 * (abs(b[k]) + norm * radius)
            if attempt > 0 and (lack < least_paid if state[k] == _PAID else lack > most_met):
                agrees = False
            paid = lack > 0.0
            state[k] = _PAID if paid else _MET
            if paid:
                root = np.sqrt(weight[k])
                factor = add_row(factor, root * a[k, 0], root * a[k, 1], root * b[k])
        if agrees:
            return x, y, True
        x, y = minimise(corners, count, factor, ux, uy, radius, scratch, scratch_cut)
    return x, y, False


@njit(cache=True)
def lock(
    corners: Array,
    count: int,
    a: Array,
    b: Array,
    least: Array,
    weight: Array,
    x: float,
    y: float,
    radius: float,
    scratch: Array,
) -> int:
    """Cut a polygon in place to the minimisers of ``Σ w_k max(m_k, v_k)²``, of which u is one.

    Each violation above m_k has one value on all of them. Returns the new number of corners.
    """
    total = 0.0
    for k in range(b.size):
        excess = max(0.0, b[k] - least[k] - a[k, 0] * x - a[k, 1] * y)
        total += weight[k] * excess * excess
    negligible = NEGLIGIBLE * np.sqrt(total)
    for k in range(b.size):
        norm = np.hypot(a[k, 0], a[k, 1])
        if weight[k] == 0.0 or norm <= ZERO_GRADIENT:
            continue
        nx, ny, d = a[k, 0] / norm, a[k, 1] / norm, (b[k] - least[k]) / norm
        value = nx * x + ny * y
        excess = norm * (d - value)
        if value < d - THIN * radius and np.sqrt(weight[k]) * excess > negligible:
            count = slice_at(corners, count, nx, ny, value, radius, scratch)
        else:
            count = cut(corners, count, nx, ny, min(value, d), radius, scratch)
    return count


@njit(cache=True)
def _slopes(
    x: float,
    y: float,
    dx: float,
    dy: float,
    a: Array,
    b: Array,
    least: Array,
    weight: Array,
    lambda_u: float,
    ux: float,
    uy: float,
    radius: float,
    state: NDArray[np.int64],
) -> tuple[float, float]:
    """Return half the directional derivatives of the cost at (x, y) towards d and towards −d.

    A row at its kink pays if the direction leads into its violation.
    """
    forward = lambda_u * ((x - ux) * dx + (y - uy) * dy)
    backward = -forward
    for k in range(b.size):
        if state[k] == _MET:
            continue
        gain = a[k, 0] * dx + a[k, 1] * dy
        lack = b[k] - a[k, 0] * x - a[k, 1] * y
        over = lack - least[k]
        rounding = THIN * radius * (abs(a[k, 0]) + abs(a[k, 1]))
        if state[k] == _PAID or over > rounding:
            forward -= weight[k] * lack * gain
            backward += weight[k] * lack * gain
        elif over > -rounding:
            forward -= weight[k] * least[k] * min(gain, 0.0)
            backward += weight[k] * least[k] * max(gain, 0.0)
    return forward, backward


@njit(cache=True)
def _settle(
    cell: Array,
    count: int,
    nx: float,
    ny: float,
    d: float,
    row: int,
    a: Array,
    b: Array,
    least: Array,
    weight: Array,
    lambda_u: float,
    ux: float,
    uy: float,
    radius: float,
    state: NDArray[np.int64],
) -> tuple[float, float, int]:
    """Minimise on the kink ``n·u = d`` of one row, and tell where the cost falls from there.

    Returns:
        The minimiser on the kink; +1 or −1 for the side with n·u above or below d, 0 for neither.
    """
    # the kink leaves the cell at A (from above to below, counter-clockwise) and enters it at B
    first_up, last_up, first_down, last_down = 0, 0, 0, 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here = nx * cell[i, 0] + ny * cell[i, 1] - d > 0.0
        there = nx * cell[j, 0] + ny * cell[j, 1] - d > 0.0
        if here and not there:
            last_up, first_down = i, j
        if there and not here:
            last_down, first_up = i, j
    px, py = _crossing(cell[last_up], cell[first_down], nx, ny, d)
    qx, qy = _crossing(cell[last_down], cell[first_up], nx, ny, d)
    dx, dy = qx - px, qy - py

    low, high = 0.0, 1.0
    at_end = 0
    start, _ = _slopes(px, py, dx, dy, a, b, least, weight, lambda_u, ux, uy, radius, state)
    _, end = _slopes(qx, qy, dx, dy, a, b, least, weight, lambda_u, ux, uy, radius, state)
    if start >= 0.0:
        t, at_end = 0.0, 1
    elif end >= 0.0:
        t, at_end = 1.0, 2
    else:
        t = -1.0
        for k in range(b.size):
            if k == row or state[k] != _OPEN:
                continue
            gain = a[k, 0] * dx + a[k, 1] * dy
            if gain == 0.0:
                continue
            s = (b[k] - least[k] - a[k, 0] * px - a[k, 1] * py) / gain
            if not low < s < high:
                continue
            x, y = px + s * dx, py + s * dy
            forward, backward = _slopes(
                x, y, dx, dy, a, b, least, weight, lambda_u, ux, uy, radius, state
            )
            if forward < 0.0:
                low, start = s, forward
            elif backward < 0.0:
                high, end = s, backward
            else:
                t = s
                break
        if t < 0.0:  # between two neighbouring kinks the slope is a straight line
            t = low + (high - low) * start / (start + end) if start + end < 0.0 else low
    x, y = px + t * dx, py + t * dy

    best, side = 0.0, 0
    for sign in (1, -1):
        ex, ey = sign * nx, sign * ny
        if at_end > 0:  # along the cell's border
            if at_end == 1:
                corner = last_up if sign > 0 else first_down
            else:
                corner = first_up if sign > 0 else last_down
            step = -1 if (at_end == 1) == (sign > 0) else 1
            corner = _beyond(cell, count, corner, step, ex, ey, sign * d, THIN * radius)
            ex, ey = cell[corner, 0] - x, cell[corner, 1] - y
            length = np.hypot(ex, ey)
            ex, ey = ex / length, ey / length
        slope, _ = _slopes(x, y, ex, ey, a, b, least, weight, lambda_u, ux, uy, radius, state)
        if slope < best:
            best, side = slope, sign
        for k in range(b.size):  # along other rows' kinks through the same point
            if k == row or state[k] != _OPEN or least[k] == 0.0:
                continue
            norm = np.hypot(a[k, 0], a[k, 1])
            if abs(a[k, 0] * x + a[k, 1] * y - b[k] + least[k]) > THIN * radius * norm:
                continue
            ex, ey = -a[k, 1] / norm, a[k, 0] / norm
            along = sign * (ex * nx + ey * ny)
            if abs(along) <= THIN:
                continue
            if along < 0.0:
                ex, ey = -ex, -ey
            if at_end > 0 and not _enters(cell, count, x, y, ex, ey, THIN * radius):
                continue
            slope, _ = _slopes(x, y, ex, ey, a, b, least, weight, lambda_u, ux, uy, radius, state)
            if slope < best:
                best, side = slope, sign
    return x, y, side


@njit(cache=True)
def _crossing(start: Array, end: Array, nx: float, ny: float, d: float) -> tuple[float, float]:
    """Return where the side from `start` to `end` crosses ``n·u = d``."""
    here = nx * start[0] + ny * start[1] - d
    there = nx * end[0] + ny * end[1] - d
    t = here / (here - there)
    return start[0] + t * (end[0] - start[0]), start[1] + t * (end[1] - start[1])


@njit(cache=True)
def _beyond(
    cell: Array, count: int, corner: int, step: int, nx: float, ny: float, d: float, thin: float
) -> int:
    """Return the first corner, from one on, whose ``n·u`` exceeds d by more than rounding."""
    for _ in range(count):
        if nx * cell[corner, 0] + ny * cell[corner, 1] - d > thin:
            break
        corner = (corner + step) % count
    return corner


@njit(cache=True)
def _enters(cell: Array, count: int, x: float, y: float, ex: float, ey: float, thin: float) -> bool:
    """Tell whether the direction e leads from the border point (x, y) into the cell."""
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        sx, sy = cell[j, 0] - cell[i, 0], cell[j, 1] - cell[i, 1]
        length = np.hypot(sx, sy)
        distance = (sx * (y - cell[i, 1]) - sy * (x - cell[i, 0])) / length
        if distance <= thin and sx * ey - sy * ex < -1e-12 * length:
            return False
    return True
