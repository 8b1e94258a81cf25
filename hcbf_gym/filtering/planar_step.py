"""From u* to u in one compiled call: margins, rows, guidance, program, status, for N plants."""

from typing import Any

import numpy as np
from numba import njit

from hcbf_gym.arrays import Array, Integers, Records
from hcbf_gym.barriers import layout, margins, row_kernels
from hcbf_gym.barriers.mapped import Scene
from hcbf_gym.barriers.margins import LEANING
from hcbf_gym.barriers.row_kernels import ALPHA2_PSI, PSI, B, H
from hcbf_gym.barriers.rows import ALPHA1, CbfRows
from hcbf_gym.compilation import borrowed
from hcbf_gym.filtering import map_rows, verdict
from hcbf_gym.filtering.monitor import APART
from hcbf_gym.filtering.planar_belief import look, watch
from hcbf_gym.filtering.planar_records import (
    OWN_ROW,
    Plants,
    Work,
    fits,
    make_work,
    program_of,
    some,
)
from hcbf_gym.filtering.report import ROW
from hcbf_gym.filtering.verdict import BACKUP
from hcbf_gym.guidance import row as guidance_row
from hcbf_gym.models.constants import ASKING, STANDING
from hcbf_gym.models.plant import Reason
from hcbf_gym.programs.planar.cascade import filter_range
from hcbf_gym.programs.planar.polygon import nearest
from hcbf_gym.programs.planar.records import Settings
from hcbf_gym.programs.tolerances import NOMINAL

DONE, NOT_FINITE, MISSHAPED, ASKS = range(4)
"""What a call says of itself."""

TOGETHER = 32
"""Plants that go through the filter together: few enough for a core's first cache."""

BARRIERS, SOLVER, MOTION = int(Reason.BARRIERS), int(Reason.SOLVER), int(Reason.MOTION)
RESPONSE = int(Reason.RESPONSE)


@njit(cache=True, nogil=True)
def filter_plants(
    constants: Records,
    program: Array,
    scene: tuple[Integers, Array, Integers, Array, Array],
    sensed: Records,
    own: Records,
    told: Records,
    rows: Records,
) -> int:
    """Filter the nominal inputs of N planar double integrators; `Plants` has the arrays.

    Args:
        constants: (1,) `plants.CONSTANTS`.
        program: the corners of U and the weights, see `plants.constants`.
        scene: kind, parameters, priority, own margin and atlas.
        sensed: what is not believed is replaced.
        own: where there are such rows, the states have been looked at, too.
        told: with u*; with own rows, the reasons stand there already.
        rows: written to.

    Returns:
        `DONE`; `NOT_FINITE` (u* is not) or `MISSHAPED` (a scene is not of N plants), and nothing is
        written; or `ASKS` where a warning is due.
    """
    c = borrowed(constants)[0]
    numbers = borrowed(program)
    plants = Plants(
        *borrowed(scene), borrowed(sensed), borrowed(own), borrowed(told), borrowed(rows)
    )
    said = _begin(c, plants)
    if said != DONE:
        return said
    count, m = plants.kind.shape
    asks = False
    if plants.atlas.size > 1:
        for i in range(count):
            asks |= _filter_mapped(c, program_of(c, numbers, i, i + 1), plants, i)
        return ASKS if asks else DONE
    work = make_work(program_of(c, numbers, 0, 1), min(count, TOGETHER), m, plants.rows.shape[1])
    for first in range(0, count, TOGETHER):
        end = min(first + TOGETHER, count)
        settings = program_of(c, numbers, first, end)
        asks |= _filter(c, settings, some(plants, first, end), work)
    return ASKS if asks else DONE


@njit(cache=True)
def _filter(c: Any, settings: Settings, some: Plants, work: Work) -> bool:
    """Filter as many plants as there is room for, and return whether a warning is due."""
    settings, p, w = borrowed(settings), borrowed(some), borrowed(work)
    count = p.kind.shape[0]
    asks = False
    _make_rows(c, p, w)
    for i in range(count):
        _ask(c, settings, p, w, i)
    rows = CbfRows(w.a, w.rows[B], w.rows[H], w.priority, w.rows[ALPHA2_PSI])
    filter_range(settings, w.u, rows, w.answer, w.polygons, 0, count)
    for i in range(count):
        _conclude(c, p, w, i)
        asks |= p.told[i].reason != 0
    return asks


@njit(cache=True)
def _filter_mapped(c: Any, settings: Settings, p: Plants, i: int) -> bool:
    """Filter plant `i` with the nearby pieces of its map, and return whether a warning is due."""
    part, source = _nearby(c, p, i)
    count, total = part.kind.shape[1], part.rows.shape[1]
    asks = _filter(c, settings, part, make_work(settings, 1, count, total))
    map_rows.tell(source, part.rows[0], p.rows[i, : p.kind.shape[1]])
    return asks


@njit(cache=True)
def _nearby(c: Any, p: Plants, i: int) -> tuple[Plants, Integers]:
    """Return plant `i` with the nearby pieces of its map, and which condition each row is of."""
    m = p.kind.shape[1]
    scene = Scene(p.kind[i], p.parameters[i], p.priority[i], p.own_margin[i], p.kind[i])
    hand = map_rows.of_plant(c, scene, p.atlas, p.sensed[i])
    count = hand.kind.size
    own = p.own[:0]
    if p.own.size > 0:
        own = np.empty((1, count), dtype=OWN_ROW)
        for r in range(count):
            own[0, r] = p.own[i, hand.source[r]]
    part = Plants(
        hand.kind.reshape(1, count),
        hand.parameters.reshape(1, count, layout.WIDTH),
        hand.priority.reshape(1, count),
        hand.own_margin.reshape(1, count),
        p.atlas[:1],
        p.sensed[i : i + 1],
        own,
        p.told[i : i + 1],
        np.empty((1, count + p.rows.shape[1] - m), dtype=ROW),
    )
    return part, hand.source


@njit(cache=True)
def pose(
    constants: Records,
    program: Array,
    scene: tuple[Integers, Array, Integers, Array, Array],
    sensed: Records,
    own: Records,
    told: Records,
    rows: Records,
) -> tuple[int, Plants, Work, Integers]:
    """Pose the problem of one plant to a solver outside, which writes the answer into `Work`.

    Args: as `filter_plants` takes them.

    Returns:
        as `filter_plants`, the plant with what is at hand, its problem, and which condition each
        row stands for.
    """
    c = borrowed(constants)[0]
    plants = Plants(*scene, sensed, own, told, rows)
    said = _begin(c, plants)
    settings = program_of(c, borrowed(program), 0, 1)
    part, source = _nearby(c, plants, 0) if said == DONE else (plants, plants.kind[0])
    work = make_work(settings, 1, part.kind.shape[1], part.rows.shape[1])
    if said == DONE:
        _make_rows(c, part, work)
        _ask(c, settings, part, work, 0)
    return said, part, work, source


@njit(cache=True)
def close(
    constants: Records,
    program: Array,
    answered: bool,
    part: Plants,
    work: Work,
    source: Integers,
    rows: Records,
) -> int:
    """Conclude what `pose` began, and return `DONE` or `ASKS`.

    Args:
        constants: (1,) `plants.CONSTANTS`.
        program: see `plants.constants`.
        answered: whether the answer stands in `work`; if not, the plant is brought to rest.
        part: of `pose`.
        work: of `pose`.
        source: of `pose`.
        rows: (1, M) `report.ROW`, written to.
    """
    c = borrowed(constants)[0]
    plant, told = part.sensed[0], part.told[0]
    if not answered and not _stops(told.reason, plant.alarm, c.brakes):
        told.reason = SOLVER
        settings = program_of(c, borrowed(program), 0, 1)
        work.u[0, 0], work.u[0, 1] = _braking_input(settings, plant, c.period)
    _conclude(c, part, work, 0)
    m = rows.shape[1] - part.rows.shape[1] + part.kind.shape[1]
    map_rows.tell(source, part.rows[0], rows[0, :m])
    return ASKS if told.reason != 0 else DONE


@njit(cache=True, inline="always")
def _begin(c: Any, plants: Plants) -> int:
    """Return what is wrong with the arrays, `DONE` for nothing; then the states are looked at."""
    for i in range(plants.told.size):
        u_nominal = plants.told[i].u_nominal
        if not np.isfinite(u_nominal[0] + u_nominal[1]):
            return NOT_FINITE
    if not fits(plants):
        return MISSHAPED
    if plants.own.size == 0:
        for i in range(plants.told.size):
            plants.told[i].reason = look(plants.sensed[i])
    return DONE


@njit(cache=True, inline="always")
def _make_rows(c: Any, p: Plants, w: Work) -> None:
    """Write the margins and the rows."""
    count, m = p.kind.shape
    x, t = p.sensed["x"], p.sensed["time"]
    for i in range(count):
        plant = p.sensed[i]
        margins.derive(c, p.kind[i], p.parameters[i], plant, c.period, w.margin[:, i])
        for k in range(m):
            w.margin[0, i, k] += p.own_margin[i, k]
            w.priority[i, k] = p.priority[i, k]
            placed = p.kind[i, k] != layout.SPEED_LIMIT and p.kind[i, k] != layout.ZONE
            w.strict[i, k] = placed and p.priority[i, k] == 1
    row_kernels.rows(p.kind, p.parameters, w.margin, x, t, c.rows, w.a, w.rows)
    if p.own.size > 0:
        _take_rows(p, w)
    if c.rounding > 0.0:
        for i in range(count):
            for k in range(m):
                if p.priority[i, k] == 1:
                    size = abs(w.a[i, k, 0]) + abs(w.a[i, k, 1])
                    w.rows[B, i, k] += c.rounding * size


@njit(cache=True, inline="always")
def _take_rows(p: Plants, w: Work) -> None:
    """Copy the rows of users' own barriers, which were made beforehand."""
    for i in range(p.kind.shape[0]):
        for k in range(p.kind.shape[1]):
            if p.kind[i, k] != layout.CUSTOM:
                continue
            row = p.own[i, k]
            w.a[i, k, 0], w.a[i, k, 1] = row.a_x, row.a_y
            w.rows[B, i, k], w.rows[H, i, k] = row.b, row.h
            w.rows[ALPHA2_PSI, i, k], w.rows[PSI, i, k] = row.alpha2_psi, row.psi
            w.margin[0, i, k] = row.margin


@njit(cache=True, inline="always")
def _ask(c: Any, settings: Settings, p: Plants, w: Work, i: int) -> None:
    """Decide what the program is asked for: u*, guided or not, or the input that brakes."""
    plant = p.sensed[i]
    told = p.told[i]
    if not _are_finite(p, w, i) and told.reason == 0:
        told.reason = BARRIERS
    told.model_error = np.sqrt(plant.error)
    if told.reason == 0:
        plant.news |= plant.follows == 0
        apart = APART if c.settles > 0.0 else 0.0
        told.model_error = watch(plant, c.radius, c.confidence, apart)
        told.reason = plant.alarm
    else:
        plant.follows = 0
    w.u[i, 0], w.u[i, 1] = told.u_nominal[0], told.u_nominal[1]
    told.reachable = 0.0
    if _stops(told.reason, plant.alarm, c.brakes):
        w.u[i, 0], w.u[i, 1] = _braking_input(settings, plant, c.period)
        _guide_nowhere(c, p, w, i)
    elif c.has_way:
        told.reachable = plant.reachable
        _guide(c, p, w, i)


@njit(cache=True, inline="always")
def _are_finite(p: Plants, w: Work, i: int) -> bool:
    """Tell whether the safety rows of a state are finite; where they are not, take them out."""
    finite = True
    m = p.kind.shape[1]
    for k in range(m):
        finite &= np.isfinite(w.a[i, k, 0] + w.a[i, k, 1] + w.rows[B, i, k] + w.rows[H, i, k])
        finite &= np.isfinite(w.rows[ALPHA2_PSI, i, k] + w.margin[0, i, k])
    if not finite:
        for k in range(m):
            w.a[i, k, 0], w.a[i, k, 1] = 0.0, 0.0
            w.rows[B, i, k], w.rows[H, i, k], w.rows[ALPHA2_PSI, i, k] = -1.0, 1.0, 1.0
            w.margin[0, i, k] = w.rows[PSI, i, k] = 0.0
    return finite


@njit(cache=True, inline="always")
def _stops(reason: int, alarm: int, brakes: bool) -> bool:
    """Tell whether a plant is brought to rest: it is not known, or an alarm asks for that."""
    return reason != 0 and (reason != alarm or brakes)


@njit(cache=True, inline="always")
def _braking_input(settings: Settings, plant: Any, period: float) -> tuple[float, float]:
    """Return the input of U nearest ``−v/T``, that nearest 0 where v is not known.

    `DoubleIntegrator.brake` is the same for a single plant.
    """
    wanted_x = wanted_y = 0.0
    if plant.known and period > 0.0:
        wanted_x, wanted_y = -plant.x[2] / period, -plant.x[3] / period
    return nearest(settings.vertices, settings.vertices.shape[0], wanted_x, wanted_y)


@njit(cache=True, inline="always")
def _guide(c: Any, p: Plants, w: Work, i: int) -> None:
    """Let guidance act on one state.

    A program that has a last rank gets its row, the others' u* is shaped by it.
    """
    plant = p.sensed[i]
    last = p.kind.shape[1]
    a_x, a_y, b = plant.way[0], plant.way[1], plant.way[2]
    if not c.guided:
        w.u[i, 0], w.u[i, 1] = guidance_row.shape(w.u[i, 0], w.u[i, 1], a_x, a_y, b)
        return
    rank = int(plant.reachable)
    guidance_row.insert(w.priority[i, :last], rank, int(plant.zone), c.through, w.priority[i])
    w.a[i, last, 0], w.a[i, last, 1] = a_x, a_y
    w.rows[B, i, last], w.rows[H, i, last], w.rows[ALPHA2_PSI, i, last] = b, 0.0, 0.0


@njit(cache=True, inline="always")
def _guide_nowhere(c: Any, p: Plants, w: Work, i: int) -> None:
    """Let the row of guidance, where there is one, ask for nothing."""
    last = p.kind.shape[1]
    if p.rows.shape[1] > last:
        guidance_row.insert(w.priority[i, :last], 0, 0, c.through, w.priority[i])
        w.a[i, last, 0], w.a[i, last, 1] = 0.0, 0.0
        w.rows[B, i, last], w.rows[H, i, last], w.rows[ALPHA2_PSI, i, last] = -1.0, 0.0, 0.0


@njit(cache=True, inline="always")
def _conclude(c: Any, p: Plants, w: Work, i: int) -> None:
    """Write what the report says of one plant."""
    plant = p.sensed[i]
    told = p.told[i]
    m = p.kind.shape[1]
    u = w.answer.u[i]
    if c.rounding > 0.0:
        u[0], u[1] = np.float32(u[0]), np.float32(u[1])
    u_nominal = told.u_nominal
    slack = w.answer.slack[i]
    delta = w.answer.delta[i]
    stops = _stops(told.reason, plant.alarm, c.brakes)
    if stops:
        _brake(told.reason == plant.alarm and told.reason not in (MOTION, RESPONSE), w, i)
    dx, dy = u[0] - u_nominal[0], u[1] - u_nominal[1]
    moved = max(abs(dx), abs(dy)) > NOMINAL * (1.0 + c.radius)
    unsafe = is_unsafe(p.kind[i], p.priority[i], w.a[i], w.rows[H, i], c.body)
    told.proved = 0
    violated = False
    believed = told.reason == 0 or told.reason == plant.alarm
    if believed:
        alpha1 = c.rows[ALPHA1 : ALPHA1 + 4]
        of_rows = w.rows[H, i, :m], w.margin[0, i], w.margin[LEANING, i], w.rows[PSI, i, :m]
        lacks = verdict.shortfall(w.strict[i], *of_rows, c.dip, c.sway, alpha1)
        violated = verdict.is_violated(plant, lacks, plant.elapsed, c.settles)
        told.proved = 0 if lacks.any else 1
    told.status = verdict.conclude(w.answer.status[i], moved, unsafe, violated, slack[:m])
    told.intervention = np.sqrt(dx * dx + dy * dy)
    told.fallbacks = w.answer.fallbacks[i]
    speed2 = plant.x[2] ** 2 + plant.x[3] ** 2
    asked2 = u_nominal[0] ** 2 + u_nominal[1] ** 2
    stands = speed2 < STANDING * STANDING and asked2 > ASKING * ASKING
    told.deadlock = 1.0 if stands else 0.0
    for k in range(2):
        told.u_safe[k] = plant.input[k] = u[k]
    for k in range(m):
        row = p.rows[i, k]
        row.slack = slack[k]
        row.delta = delta[k]
        row.margin = w.margin[0, i, k]
        row.h = w.rows[H, i, k] if believed else np.nan
        row.psi = w.rows[PSI, i, k] if believed else np.nan
        steers = w.a[i, k, 0] != 0.0 or w.a[i, k, 1] != 0.0
        row.conditioning = 1.0 if believed and steers else 0.0
        if p.own.size > 0 and p.kind[i, k] == layout.CUSTOM:
            row.margin += p.own[i, k].dip


@njit(cache=True, inline="always")
def _brake(rows_hold: bool, w: Work, i: int) -> None:
    """Make one answer that of a plant that is brought to rest.

    After an alarm the state is believed, but the plant no longer: what it does by itself may bring
    it to a region, and the program's answer to the braking input keeps it away. Without a state
    that is believed the rows say nothing, and the braking input is applied.
    """
    answer = w.answer
    if not rows_hold:
        answer.u[i, 0], answer.u[i, 1] = w.u[i, 0], w.u[i, 1]
        answer.slack[i, :], answer.delta[i, :] = 0.0, 0.0
    answer.status[i] = BACKUP


@njit(cache=True)
def is_unsafe(kind: Integers, priority: Integers, a: Array, h: Array, body: float) -> bool:
    """Tell whether a strict ``h − ρ‖∇h‖``, the whole body's where h is a distance, is below zero.

    Args:
        kind: (m,) of the barriers; a speed limit and a zone have no place.
        priority: (m,).
        a: (M, 2) of the rows, ∇h; M is m or more.
        h: (M,) of the body's centre.
        body: ρ, what the body reaches beyond its centre [m].
    """
    for k in range(kind.size):
        reach = 0.0
        if body > 0.0 and kind[k] != layout.SPEED_LIMIT and kind[k] != layout.ZONE:
            reach = body * np.sqrt(a[k, 0] * a[k, 0] + a[k, 1] * a[k, 1])
        if priority[k] == 1 and h[k] < reach:
            return True
    return False
