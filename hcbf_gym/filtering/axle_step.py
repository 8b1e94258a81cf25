"""What the filter does otherwise for a differential drive; see `barriers.axle_rows`.

What stands binds the axle, what moves and users' own conditions the point before it. U is a
rectangle along the heading. Where rows on what stands keep a robot from what was asked for, it asks
for what a robot that moves in every direction would do there: so it turns along a wall instead of
standing before it.
"""

import numpy as np

from hcbf_gym.arrays import Array, Mask, Record, Records
from hcbf_gym.barriers import axle_rows, layout, margins, row_kernels, zone
from hcbf_gym.barriers.margins import MARGIN, QUICKENING, RATE, Known
from hcbf_gym.barriers.row_kernels import ALPHA2_PSI, B, H
from hcbf_gym.barriers.rows import ALPHA2, PERIOD, SETTINGS_WIDTH, U_MAX, CbfRows
from hcbf_gym.compilation import kernel, put
from hcbf_gym.filtering.plants import Plants, Work
from hcbf_gym.models import axle as drives
from hcbf_gym.models.axle import Axle
from hcbf_gym.programs.planar.cascade import filter_range
from hcbf_gym.programs.planar.polygon import nearest
from hcbf_gym.programs.planar.records import Settings, own_of
from hcbf_gym.programs.result import FilterResult

FACING = -0.2
"""The cosine between heading and way below which guidance turns the robot first."""
TURNING, SOON = 2.0, 0.1
"""Gain with which it turns to its way where u* leads back from there [1/s], and how soon [s]."""
MOVED = 1e-9
"""By how much an input must be changed before the robot slides along what stands [m/s²]."""
ASIDE = 0.2
"""How hard one that is guided keeps off what it slides along [m/s²]: parallel to an edge, or not
quite, it cannot drive yet, and would turn ever more slowly."""
STEADY = 10.0
"""How much more a turn counts than a change of speed, where it backs from an edge."""


@kernel(inline="always")
def axle_of(c: Record) -> Axle:
    """Return what limits the drive, of `plants.CONSTANTS`."""
    return Axle(c.axle[0], c.axle[1], c.axle[2], c.axle[3])


@kernel(inline="always")
def moves(kind: int, parameters: Array) -> bool:
    """Return whether a condition binds the point: it moves, or is a user's own."""
    if kind == layout.SPEED_LIMIT or kind == layout.ZONE:
        return False
    still = parameters[layout.VELOCITY_X] == 0.0 and parameters[layout.VELOCITY_Y] == 0.0
    return kind == layout.CUSTOM or not still


@kernel()
def place(c: Record, plant: Record) -> Known:
    """Return what is known of the axle."""
    axle, heading = axle_of(c), plant.heading
    of_axle = np.empty((3, 4))
    x, model, lag = of_axle[0], of_axle[1], of_axle[2]
    for k in range(4):
        lag[k] = plant.model[k] + plant.lag[k]  # the body
    drives.place(axle, plant.x, heading, x)
    drives.place(axle, plant.model, heading, model)
    drives.place(axle, lag, heading, lag)
    for k in range(4):
        lag[k] -= model[k]
    return Known(x, plant.time, model, lag, plant.covariance, plant.growth)


@kernel()
def make_rows(c: Record, p: Plants, w: Work, i: int) -> None:
    """Write margins, rows and U of one plant; those of users' own conditions are made later."""
    plant, axle = p.sensed[i], axle_of(c)
    known = place(c, plant)
    margins.derive(c, p.kind[i], p.parameters[i], known, c.period, w.margin[:, i])
    for k in range(p.kind.shape[1]):
        w.margin[QUICKENING, i, k] += c.jerk
        w.margin[MARGIN, i, k] += p.own_margin[i, k]
    settings = np.empty(SETTINGS_WIDTH)
    put(settings, c.axle_rows)
    axle_rows.limit_axle(axle, plant.x, plant.heading, settings)
    _rows(p, i, known.x, settings, w.margin[:, i : i + 1], w.a[i : i + 1], w.rows[:, i : i + 1])
    settings[U_MAX] = axle.braking  # of the speed: what turns it changes no speed
    for k in range(p.kind.shape[1]):
        if p.kind[i, k] == layout.SPEED_LIMIT:
            v_max, margin, rate = (
                p.parameters[i, k, layout.V_MAX],
                w.margin[0, i, k],
                w.margin[1, i, k],
            )
            kept, v = w.rows[H, i, k] - margin, known.x
            w.rows[B, i, k] = row_kernels.speed_row(
                kept, rate, v[2], v[3], v_max, settings[ALPHA2 : ALPHA2 + 4], settings
            )[0]
        if p.kind[i, k] == layout.ZONE:
            w.rows[B, i, k] = _zone_row(axle, p.parameters[i, k], w, i, k, known.x, settings)
        n, b = w.a[i, k], w.rows[B, i, k]
        w.straight[i, k, 0], w.straight[i, k, 1], w.straight[i, k, 2] = n[0], n[1], b
        if p.kind[i, k] == layout.SPEED_LIMIT or p.kind[i, k] == layout.ZONE:
            continue  # n is along the heading, and e·u alone changes the speed
        n[0], n[1], w.rows[B, i, k] = axle_rows.of_axle(
            axle, plant.x, plant.heading, c.period, n[0], n[1], b
        )
    _rows_of_point(c, p, w, i)


@kernel()
def _zone_row(axle: Axle, c: Array, w: Work, i: int, k: int, x: Array, settings: Array) -> float:
    """Return b of a zone: braking alone changes the speed, turning the position besides.

    Args:
        axle: what limits the drive.
        c: (WIDTH,) block of the zone.
        w: with h and the margins.
        i: which plant.
        k: which row.
        x: (4,) of the axle.
        settings: (15,) of rows, with the braking for u_max.
    """
    later = np.hypot(x[2], x[3]) + axle.braking * settings[PERIOD]
    hardest = np.hypot(axle.braking, later * axle.turn)
    kept = w.rows[H, i, k] - w.margin[MARGIN, i, k]
    closing = c[layout.AWAY_X] * x[2] + c[layout.AWAY_Y] * x[3]
    return zone.row(
        kept, w.margin[RATE, i, k], closing, x[2], x[3], c[layout.V_MAX], settings, hardest,
    )[0]  # fmt: skip


@kernel()
def carry_on(axle: Axle, plant: Record) -> None:
    """Let a plant that is not believed go on turning, as its model goes on."""
    plant.heading = plant.headed
    if not plant.known or not plant.elapsed > 0.0:
        return
    _, turning = drives.speeds(axle, plant.x, plant.headed)
    plant.heading += turning * plant.elapsed
    cos, sin = np.cos(turning * plant.elapsed), np.sin(turning * plant.elapsed)
    _turn(plant.x[2:], cos, sin)
    _turn(plant.model[2:], cos, sin)
    _turn(plant.believed[2:], cos, sin)


@kernel()
def _rows_of_point(c: Record, p: Plants, w: Work, i: int) -> None:
    """Write margins and rows of what moves, which bind the point."""
    some = False
    for k in range(p.kind.shape[1]):
        some |= moves(p.kind[i, k], p.parameters[i, k]) and p.kind[i, k] != layout.CUSTOM
    if not some:
        return
    m, known = p.kind.shape[1], _known_of(p.sensed[i])
    a, settings = np.empty((1, m, 2)), np.empty(SETTINGS_WIDTH)
    put(settings, c.rows)
    both = np.empty((8, 2, m))[:, :1]  # lies as the axle's do, so that nothing is compiled twice
    reserved, rows = both[:4], both[4:]
    margins.derive(c, p.kind[i], p.parameters[i], known, c.period, reserved[:, 0])
    for k in range(m):
        reserved[MARGIN, 0, k] += p.own_margin[i, k] + axle_of(c).look_ahead
    _rows(p, i, known.x, settings, reserved, a, rows)
    for k in range(m):
        if moves(p.kind[i, k], p.parameters[i, k]) and p.kind[i, k] != layout.CUSTOM:
            for q in range(4):
                w.margin[q, i, k], w.rows[q, i, k] = reserved[q, 0, k], rows[q, 0, k]
            w.a[i, k, 0], w.a[i, k, 1] = a[0, k, 0], a[0, k, 1]
            turn_row(c, p, w, i, k)


@kernel()
def turn_row(c: Record, p: Plants, w: Work, i: int, k: int) -> None:
    """Write a row on the point as one in u: its velocity turns with the heading besides."""
    plant, n, b = p.sensed[i], w.a[i, k], w.rows[B, i, k]
    w.straight[i, k, 0], w.straight[i, k, 1], w.straight[i, k, 2] = n[0], n[1], b
    n[0], n[1], w.rows[B, i, k] = axle_rows.of_point(
        axle_of(c), plant.x, plant.heading, c.period, n[0], n[1], b
    )


@kernel()
def _known_of(plant: Record) -> Known:
    """Return what is known of the point, in memory as that of the axle."""
    of_point = np.empty((3, 4))
    for k in range(4):
        of_point[0, k], of_point[1, k], of_point[2, k] = plant.x[k], plant.model[k], plant.lag[k]
    x, model, lag = of_point[0], of_point[1], of_point[2]
    return Known(x, plant.time, model, lag, plant.covariance, plant.growth)


@kernel()
def _rows(
    p: Plants, i: int, x: Array, settings: Array, margin: Array, a: Array, out: Array
) -> None:
    """Write the rows of one plant, whose axle or point has the state x (4,)."""
    kind, parameters = p.kind[i : i + 1], p.parameters[i : i + 1]
    time, at = p.sensed["time"][i : i + 1], x.reshape(1, 4)
    row_kernels.rows(kind, parameters, margin, at, time, settings, a, out)


@kernel()
def limit(c: Record, settings: Settings, p: Plants) -> None:
    """Write the corners of each plant's U into the program."""
    for i in range(p.sensed.size):
        plant = p.sensed[i]
        corners = own_of(settings, i).vertices
        drives.corners(axle_of(c), plant.x, plant.heading, c.period, corners)


@kernel()
def turn_memory(plant: Record) -> None:
    """Turn what was expected of the point's velocity with the heading since the last sample.

    What the robot is told is held in its own axes.
    """
    turn = plant.heading - plant.headed
    cos, sin = np.cos(turn), np.sin(turn)
    _turn(plant.expected, cos, sin)
    _turn(plant.input, cos, sin)
    plant.headed = plant.heading


@kernel(inline="always")
def _turn(pair: Array, cos: float, sin: float) -> None:
    """Turn a vector in the plane."""
    one, other = pair[0], pair[1]
    pair[0], pair[1] = cos * one - sin * other, sin * one + cos * other


@kernel()
def split_ranks(p: Plants, w: Work, i: int) -> None:
    """Let what stands come before what moves in rank 1: where both cannot be, the robot stays out.

    A robot that a region runs into has not entered it.
    """
    for k in range(w.priority.shape[1]):
        later = w.priority[i, k] > 1
        if k < p.kind.shape[1] and p.priority[i, k] == 1:
            later = moves(p.kind[i, k], p.parameters[i, k])
        w.priority[i, k] += 1 if later else 0


@kernel()
def slide(c: Record, settings: Settings, p: Plants, w: Work, i: int) -> None:
    """Answer once more where rows changed u, with what a robot free to move would do for u*.

    One that is guided keeps off a single edge besides, and turns to a way that lies behind it. One
    that backs from it turns as it would: a row has the turn times v, so that the turn was given
    away, to and fro, for a hair of speed.

    Args:
        c: `plants.CONSTANTS`.
        settings: of the program, with each plant's U.
        p: the plants, with their conditions.
        w: with the program's answer, written to.
        i: which plant.
    """
    m, heading = p.kind.shape[1], p.sensed[i].heading
    vertices, u = own_of(settings, i).vertices, w.answer.u[i]
    x, y = nearest(vertices, vertices.shape[0], w.u[i, 0], w.u[i, 1])
    if abs(u[0] - x) + abs(u[1] - y) <= MOVED:
        return
    far = 4.0 * settings.radius + 2.0 * max(abs(w.u[i, 0]), abs(w.u[i, 1]))
    square = np.array([[-far, -far], [far, -far], [far, far], [-far, far]])
    part, asked = _answer_of(w.answer, i), w.u[i : i + 1].copy()
    a, b = w.a[i : i + 1].copy(), w.rows[B, i : i + 1].copy()
    for k in range(m):
        a[0, k, 0], a[0, k, 1], b[0, k] = w.straight[i, k]
    h, priority, psi = w.rows[H, i : i + 1], w.priority[i : i + 1], w.rows[ALPHA2_PSI, i : i + 1]
    free = CbfRows(a, b, h, priority, psi)
    filter_range(_with(settings, i, square), asked, free, part, w.polygons, 0, 1)
    asked[0, 0], asked[0, 1] = part.u[0, 0], part.u[0, 1]
    held, edges, edge = False, 0, 0
    for k in range(m):
        if a[0, k, 0] * asked[0, 0] + a[0, k, 1] * asked[0, 1] - b[0, k] <= MOVED:
            held = True
            if _is_edge(p.kind[i, k]):
                edges, edge = edges + 1, k
    if edges == 1 and m < a.shape[1]:  # between two it would turn from both
        asked[0, 0] += ASIDE * a[0, edge, 0]
        asked[0, 1] += ASIDE * a[0, edge, 1]
    a, b = w.a[i : i + 1].copy(), w.rows[B, i : i + 1].copy()
    backs = edges == 1 and drives.speeds(axle_of(c), p.sensed[i].x, heading)[0] < 0.0
    if backs:  # what was asked for has what guidance may have
        a[0, m:], b[0, m:] = 0.0, -1.0
    elif held:  # guidance drives ahead, and turns along what stands and not back to its way
        cos, sin = np.cos(heading), np.sin(heading)
        for k in range(m, a.shape[1]):
            ahead, aside = cos * a[0, k, 0] + sin * a[0, k, 1], cos * a[0, k, 1] - sin * a[0, k, 0]
            b[0, k] -= aside * (cos * asked[0, 1] - sin * asked[0, 0])
            ahead = max(0.0, ahead)  # backing to a way behind it, it would turn from it, too
            a[0, k, 0], a[0, k, 1] = ahead * cos, ahead * sin
    corners, rows = vertices.copy(), CbfRows(a, b, h, priority, psi)
    if backs:
        _to_axes(a[0], heading, 1.0 / STEADY)
        _to_axes(asked, heading, STEADY)
        _to_axes(corners, heading, STEADY)
    filter_range(_with(settings, i, corners), asked, rows, part, w.polygons, 0, 1)
    if backs:
        part.u[0, 1] /= STEADY
        _turn(part.u[0], np.cos(heading), np.sin(heading))


@kernel()
def _to_axes(vectors: Array, heading: float, share: float) -> None:
    """Turn vectors (n, 2) into the axes of the heading, and stretch what lies across."""
    cos, sin = np.cos(heading), np.sin(heading)
    for k in range(vectors.shape[0]):
        _turn(vectors[k], cos, -sin)
        vectors[k, 1] *= share


@kernel(inline="always")
def _is_edge(kind: int) -> bool:
    """Return whether a condition is on the place, by a unit normal; an own one may be anything."""
    return kind != layout.SPEED_LIMIT and kind != layout.ZONE and kind != layout.CUSTOM


@kernel()
def _answer_of(answer: FilterResult, i: int) -> FilterResult:
    """Return the answer's part of one plant, with a leading 1."""
    return FilterResult(
        answer.u[i : i + 1],
        answer.slack[i : i + 1],
        answer.delta[i : i + 1],
        answer.status[i : i + 1],
        answer.fallbacks[i : i + 1],
    )


@kernel()
def _with(s: Settings, i: int, vertices: Array) -> Settings:
    """Return the program of one plant with a U of corners (4, 2)."""
    weights = s.weights[i : i + 1] if s.weights.shape[0] > 1 else s.weights
    return Settings(
        s.lower, s.by_level, s.lock, s.ranks, s.guided, s.radius, s.lambda_u, s.known_offset,
        vertices.reshape(1, 4, 2), weights,
    )  # fmt: skip


@kernel()
def face(plants: Records, u_nominal: Array, gain: float, ahead: float) -> None:
    """Let guidance turn robots that face away from their way, by the point before the axle.

    Where u* leads back from the way, it would turn the robot from there, too, as far as the row of
    guidance can be met by going on ahead: to and fro, for ever. There guidance alone turns it.

    Args:
        plants: (N,) `plants.PLANT`; the row (a, b) of guidance is written to.
        u_nominal: (N, 2) u* [m/s²].
        gain: k of that row [1/s].
        ahead: ℓ of the axles [m].
    """
    for i in range(plants.size):
        plant, u = plants[i], u_nominal[i]
        way, cos, sin = plant.way, np.cos(plant.heading), np.sin(plant.heading)
        along, across = cos * way[0] + sin * way[1], cos * way[1] - sin * way[0]
        plant.turns = way[0] * u[0] + way[1] * u[1] < min(way[2], 0.0)
        if plant.turns:
            turning = cos * plant.x[3] - sin * plant.x[2]
            plant.turn = (TURNING * ahead * np.arctan2(across, along) - turning) / SOON
        if not along < FACING:
            continue
        speed = way[2] / gain + way[0] * plant.x[2] + way[1] * plant.x[3]
        side = 1.0 if across >= 0.0 else -1.0
        way[0], way[1] = -side * sin, side * cos
        way[2] = gain * (speed - way[0] * plant.x[2] - way[1] * plant.x[3])


@kernel()
def turn_to_way(plant: Record, u: Array) -> None:
    """Let u (2,) turn a plant to its way where u* leads back from there."""
    if plant.turns:
        cos, sin = np.cos(plant.heading), np.sin(plant.heading)
        ahead = cos * u[0] + sin * u[1]
        u[0], u[1] = ahead * cos - plant.turn * sin, ahead * sin + plant.turn * cos


@kernel()
def of_body(c: Record, p: Plants, i: int, h: Array, strict: Mask) -> Array:
    """Return h (m,) of the axle: of what binds the point it is no less than the point's less ℓ."""
    out = h.copy()
    for k in range(h.size):
        if strict[k] and moves(p.kind[i, k], p.parameters[i, k]):
            out[k] -= c.axle[0]
    return out
