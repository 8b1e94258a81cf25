"""From u* to u in one compiled call: margins, rows, guidance, program, status, for N plants.

Of planar double integrators all of it happens here. Of other models `model_core` has looked at the
states, and made rows, alarms and braking inputs, beforehand.
"""

import numpy as np

from hcbf_gym.arrays import Array, Integers, Mask, Record, Records
from hcbf_gym.barriers import general_kernels, layout, margins, row_kernels
from hcbf_gym.barriers.general_kernels import CONDITIONING, DIP, FAST, PLACED, REACH, WIDTH
from hcbf_gym.barriers.mapped import Scene
from hcbf_gym.barriers.margins import LEANING
from hcbf_gym.barriers.row_kernels import ALPHA2_PSI, PSI, B, H
from hcbf_gym.barriers.rows import ALPHA1, CbfRows
from hcbf_gym.compilation import borrowed, kernel, put
from hcbf_gym.filtering import axle_step, map_rows, report, verdict
from hcbf_gym.filtering.belief import believe
from hcbf_gym.filtering.monitor import watch
from hcbf_gym.filtering.plants import (
    CONSTANTS,
    PLANT,
    Drives,
    Plants,
    Work,
    fits,
    make_work,
    program_of,
    some,
)
from hcbf_gym.filtering.report import PLANT_WORDS, ROW
from hcbf_gym.filtering.verdict import BACKUP
from hcbf_gym.guidance import row as guidance_row
from hcbf_gym.models.plant import FIRST_ALARM, Reason
from hcbf_gym.programs.planar.cascade import filter_range
from hcbf_gym.programs.planar.polygon import nearest
from hcbf_gym.programs.planar.records import Settings, own_of
from hcbf_gym.programs.tolerances import NOMINAL

DONE, NOT_FINITE, MISSHAPED, ASKS = range(4)
"""What a call says of itself."""

TOGETHER = 32
"""Plants that go through the filter together: few enough for a core's first cache."""

BARRIERS, SOLVER, MOTION = int(Reason.BARRIERS), int(Reason.SOLVER), int(Reason.MOTION)
GOAL, RESPONSE, MOVES = int(Reason.GOAL), int(Reason.RESPONSE), int(Reason.MOVES)
ALARM = int(FIRST_ALARM)


@kernel(nogil=True)
def filter_plants(
    constants: Array,
    program: Array,
    drives: Drives,
    kind: Integers,
    parameters: Array,
    priority: Integers,
    own_margin: Array,
    atlas: Array | None,
    sensed: Array,
    own: Array,
    told: Array,
    rows: Array,
) -> int:
    """Filter the nominal inputs of N plants of two inputs; `Plants` has the arrays.

    Records come as the numbers that they are made of, and arrays one by one: Python hands those
    over in half the time. Of an argument that is None Numba compiles nothing: a point asks for no
    axle, a scene without a map for no pieces.

    Args:
        constants: the numbers of a `plants.CONSTANTS`.
        program: the corners of U and the weights, see `plants.constants`.
        drives: None of points, True of robots with an axle.
        kind: of the scenes.
        parameters: likewise.
        priority: likewise.
        own_margin: likewise.
        atlas: (L,) where the pieces of maps stand; None where there is no map.
        sensed: the numbers of N `plants.PLANT`; what is not believed is replaced.
        own: where there are such rows, the states have been looked at, too.
        told: the numbers of N `report.PLANT`, with u*; with own rows, the reasons stand there
            already.
        rows: the numbers of (N, M) `report.ROW`, written to.

    Returns:
        `DONE`; `NOT_FINITE` (u* is not) or `MISSHAPED` (a scene is not of N plants), and nothing is
        written; or `ASKS` where a warning is due.
    """
    c = borrowed(constants).view(CONSTANTS)[0]
    numbers = borrowed(program)
    plants = Plants(
        borrowed(kind),
        borrowed(parameters),
        borrowed(priority),
        borrowed(own_margin),
        borrowed(sensed).view(PLANT),
        borrowed(own),
        borrowed(told).view(report.PLANT),
        _rows_of(borrowed(rows).view(ROW), told.size // PLANT_WORDS),
    )
    said = _begin(c, drives, plants)
    if said != DONE:
        return said
    count, m = plants.kind.shape
    asks = False
    if atlas is not None:
        pieces = borrowed(atlas)
        for i in range(count):
            settings = program_of(c, numbers, i, i + 1)
            asks |= _filter_mapped(c, settings, drives, plants, pieces, i)
        return ASKS if asks else DONE
    work = make_work(
        program_of(c, numbers, 0, 1), min(count, TOGETHER), m, plants.rows.shape[1], 2, drives
    )
    for first in range(0, count, TOGETHER):
        end = min(first + TOGETHER, count)
        settings = program_of(c, numbers, first, end)
        asks |= _filter(c, settings, drives, some(plants, first, end), work)
    return ASKS if asks else DONE


@kernel(inline="always")
def _rows_of(rows: Records, count: int) -> Records:
    """Return (N, M) the rows of N plants."""
    return rows.reshape(count, rows.size // max(1, count))


@kernel()
def _filter(c: Record, settings: Settings, drives: Drives, some: Plants, work: Work) -> bool:
    """Filter as many plants as there is room for, and return whether a warning is due."""
    settings, p, w = borrowed(settings), borrowed(some), borrowed(work)
    count = p.kind.shape[0]
    asks = False
    _make_rows(c, drives, p, w)
    if drives is not None:
        axle_step.limit(c, settings, p)
    for i in range(count):
        _ask(c, settings, drives, p, w, i)
    rows = CbfRows(w.a, w.rows[B], w.rows[H], w.priority, w.rows[ALPHA2_PSI])
    filter_range(settings, w.u, rows, w.answer, w.polygons, 0, count)
    if drives is not None:
        for i in range(count):
            if p.told[i].reason == 0:
                axle_step.slide(c, settings, p, w, i)
    for i in range(count):
        _conclude(c, drives, p, w, i)
        asks |= p.told[i].reason != 0
    return asks


@kernel()
def _filter_mapped(
    c: Record, settings: Settings, drives: Drives, p: Plants, atlas: Array, i: int
) -> bool:
    """Filter plant `i` with the nearby pieces of its map, and return whether a warning is due."""
    part, source = _nearby(c, drives, p, atlas, i)
    count, total = part.kind.shape[1], part.rows.shape[1]
    work = make_work(settings, 1, count, total, 2, drives)
    asks = _filter(c, settings, drives, part, work)
    map_rows.tell(source, part.rows[0], p.rows[i, : p.kind.shape[1]])
    return asks


@kernel()
def _nearby(c: Record, drives: Drives, p: Plants, atlas: Array, i: int) -> tuple[Plants, Integers]:
    """Return plant `i` with the nearby pieces of its map, and which condition each row is of."""
    m = p.kind.shape[1]
    scene = Scene(p.kind[i], p.parameters[i], p.priority[i], p.own_margin[i], p.kind[i])
    hand = map_rows.of_plant(c, drives, scene, atlas, p.sensed[i])
    count = hand.kind.size
    own = p.own[:0]
    if p.own.size > 0:
        own = np.empty((1, count, p.own.shape[2]))
        for r in range(count):
            own[0, r] = p.own[i, hand.source[r]]
    part = Plants(
        hand.kind.reshape(1, count),
        hand.parameters.reshape(1, count, layout.WIDTH),
        hand.priority.reshape(1, count),
        hand.own_margin.reshape(1, count),
        p.sensed[i : i + 1],
        own,
        p.told[i : i + 1],
        np.empty((1, count + p.rows.shape[1] - m), dtype=ROW),
    )
    return part, hand.source


@kernel()
def pose(
    constants: Records, program: Array, drives: Drives, plants: Plants, atlas: Array | None
) -> tuple[int, Plants, Work, Integers]:
    """Pose problems to a solver outside, which writes the answers into `Work`.

    Args:
        constants: (1,) `plants.CONSTANTS`.
        program: see `plants.constants`.
        drives: as `filter_plants` takes it.
        plants: one planar double integrator, or N plants of any model and number of inputs.
        atlas: as `filter_plants` takes it.

    Returns:
        as `filter_plants`, the plants with what is at hand, their problems, and which condition
        each row stands for; of other models (0,).
    """
    c = borrowed(constants)[0]
    said = _begin(c, drives, plants)
    settings = program_of(c, borrowed(program), 0, 1)
    part, source = plants, np.empty(0, dtype=np.int64)
    if atlas is not None and said == DONE and not c.made:
        part, source = _nearby(c, drives, plants, atlas, 0)
    count, m = part.kind.shape
    work = make_work(settings, count, m, part.rows.shape[1], part.told[0].u_safe.size, drives)
    if said == DONE:
        _make_rows(c, drives, part, work)
        for i in range(count):
            _ask(c, settings, drives, part, work, i)
    return said, part, work, source


@kernel()
def close(
    constants: Records,
    program: Array,
    drives: Drives,
    answered: Mask,
    posed: tuple[Plants, Work, Integers],
    rows: Records,
) -> int:
    """Conclude what `pose` began, and return `DONE` or `ASKS`.

    Args:
        constants: (1,) `plants.CONSTANTS`.
        program: see `plants.constants`.
        drives: as `filter_plants` takes it.
        answered: (N,) whether the answer stands in `work`; if not, the plant is brought to rest.
        posed: by `pose`: plants, problems and sources.
        rows: (N, M) `report.ROW`, written to.
    """
    c = borrowed(constants)[0]
    part, work, source = posed
    settings = program_of(c, borrowed(program), 0, 1)
    asks = False
    for i in range(answered.size):
        plant, told = part.sensed[i], part.told[i]
        if not answered[i]:
            if not _stops(told.reason, c.brakes):
                told.reason = SOLVER
                _wish_to_stop(c, own_of(settings, i).vertices, plant, work.u[i])
            _apply(work, i)
        _conclude(c, drives, part, work, i)
        asks |= told.reason != 0
    if source.size > 0:
        m = rows.shape[1] - part.rows.shape[1] + part.kind.shape[1]
        map_rows.tell(source, part.rows[0], rows[0, :m])
    return ASKS if asks else DONE


@kernel(inline="always")
def _begin(c: Record, drives: Drives, plants: Plants) -> int:
    """Return what is wrong with the arrays, `DONE` for nothing; then the states are looked at."""
    for i in range(plants.told.size):
        u_nominal = plants.told[i].u_nominal
        for j in range(u_nominal.size):
            if not np.isfinite(u_nominal[j]):
                return NOT_FINITE
    if not fits(plants, c.guided and c.has_way):
        return MISSHAPED
    if plants.own.size == 0 and not c.made:
        for i in range(plants.told.size):
            plants.told[i].reason = believe(plants.sensed[i])
    if drives is not None:
        for i in range(plants.told.size):
            if plants.told[i].reason != 0:  # before anything is looked up where the axle is
                axle_step.carry_on(axle_step.axle_of(c), plants.sensed[i])
    return DONE


@kernel(inline="always")
def _make_rows(c: Record, drives: Drives, p: Plants, w: Work) -> None:
    """Write the margins and the rows."""
    count, m = p.kind.shape
    for i in range(count):
        for k in range(m):
            w.priority[i, k] = p.priority[i, k]
    if c.made:
        w.margin[:, :, :] = 0.0
    else:
        _make_planar_rows(c, drives, p, w)
    if p.own.size > 0:
        _take_rows(c, drives, p, w)
    if c.rounding > 0.0:
        for i in range(count):
            for k in range(m):
                if p.priority[i, k] == 1:
                    size = 0.0
                    for j in range(w.a.shape[2]):
                        size += abs(w.a[i, k, j])
                    w.rows[B, i, k] += c.rounding * size


@kernel(inline="always")
def _make_planar_rows(c: Record, drives: Drives, p: Plants, w: Work) -> None:
    """Write the margins and rows of planar double integrators, users' own barriers left out."""
    count, m = p.kind.shape
    for i in range(count):
        for k in range(m):
            placed = p.kind[i, k] != layout.SPEED_LIMIT and p.kind[i, k] != layout.ZONE
            w.strict[i, k] = placed and p.priority[i, k] == 1
        if drives is not None:
            axle_step.make_rows(c, p, w, i)
        else:
            plant = p.sensed[i]
            margins.derive(c, p.kind[i], p.parameters[i], plant, c.period, w.margin[:, i])
            for k in range(m):
                w.margin[0, i, k] += p.own_margin[i, k]
    if drives is None:
        x, t = p.sensed["x"], p.sensed["time"]
        row_kernels.rows(p.kind, p.parameters, w.margin, x, t, c.rows, w.a, w.rows)


@kernel(inline="always")
def _take_rows(c: Record, drives: Drives, p: Plants, w: Work) -> None:
    """Copy the rows that were made beforehand."""
    for i in range(p.kind.shape[0]):
        for k in range(p.kind.shape[1]):
            if p.kind[i, k] == layout.NONE:
                row_kernels.leave_out(i, k, w.a, w.rows)
                w.strict[i, k] = False
                continue
            if not c.made and p.kind[i, k] != layout.CUSTOM:
                continue
            row = p.own[i, k]
            for j in range(w.a.shape[2]):
                w.a[i, k, j] = row[WIDTH + j]
            for q in range(4):  # b, h, α₂(ψ) and ψ
                w.rows[q, i, k] = row[q]
            w.margin[0, i, k] = row[general_kernels.MARGIN]
            w.margin[LEANING, i, k] = row[general_kernels.LEANING]
            w.strict[i, k] = row[PLACED] != 0.0 and p.priority[i, k] == 1
            if drives is not None:
                axle_step.turn_row(c, p, w, i, k)


@kernel(inline="always")
def _ask(c: Record, settings: Settings, drives: Drives, p: Plants, w: Work, i: int) -> None:
    """Decide what the program is asked for: u*, guided or not, or the input that brakes."""
    plant = p.sensed[i]
    told = p.told[i]
    if not _are_finite(p, w, i) and told.reason == 0:
        told.reason = BARRIERS
    if drives is not None:
        axle_step.turn_memory(plant)
    if told.reason == 0:
        if not c.made:
            exact = c.settles == 0.0 and drives is None
            watch(plant, c.radius, c.confidence, exact, c.observed)
        told.reason = plant.alarm
        if told.reason == 0 and plant.moves != 0:
            told.reason = MOVES
        if plant.lost != 0 and not _stops(told.reason, c.brakes):
            told.reason = GOAL
    else:
        plant.follows = 0
    told.model_error = np.sqrt(plant.error)
    told.reachable = 0.0
    if _stops(told.reason, c.brakes):
        _wish_to_stop(c, own_of(settings, i).vertices, plant, w.u[i])
        _guide_nowhere(c, p, w, i)
        if drives is not None and c.by_level:
            axle_step.split_ranks(p, w, i)
        return
    for j in range(told.u_nominal.size):
        w.u[i, j] = told.u_nominal[j]
    if c.has_way:
        told.reachable = plant.reachable
        if drives is not None:
            axle_step.turn_to_way(plant, w.u[i])
        _guide(c, p, w, i)
    if drives is not None and c.by_level:
        axle_step.split_ranks(p, w, i)


@kernel(inline="always")
def _are_finite(p: Plants, w: Work, i: int) -> bool:
    """Return whether the safety rows of a state are finite; where they are not, take them out."""
    finite = True
    m = p.kind.shape[1]
    for k in range(m):
        whole = w.rows[B, i, k] + w.rows[H, i, k]
        for j in range(p.told[i].u_nominal.size):
            whole += w.a[i, k, j]
        finite &= np.isfinite(whole)
        finite &= np.isfinite(w.rows[ALPHA2_PSI, i, k] + w.margin[0, i, k])
    if not finite:
        for k in range(m):
            row_kernels.leave_out(i, k, w.a, w.rows)
            w.margin[0, i, k] = 0.0
    return finite


@kernel(inline="always")
def _stops(reason: int, brakes: bool) -> bool:
    """Return whether a plant is brought to rest: it or its path is unknown, or for an alarm."""
    return reason != 0 and (reason < ALARM or brakes)


@kernel(inline="always")
def _wish_to_stop(c: Record, vertices: Array, plant: Record, u: Array) -> None:
    """Write the input of U nearest to what stops the plant's model, to 0 where no state is known.

    `DoubleIntegrator.brake` has ``−v/T`` for a single plant; those of other models stand in `stop`.
    """
    if c.made:
        for j in range(u.size):
            u[j] = plant.stop[j]
        return
    wanted_x = wanted_y = 0.0
    if plant.known and c.period > 0.0:
        wanted_x, wanted_y = -plant.x[2] / c.period, -plant.x[3] / c.period
    u[0], u[1] = nearest(vertices, vertices.shape[0], wanted_x, wanted_y)


@kernel(inline="always")
def _guide(c: Record, p: Plants, w: Work, i: int) -> None:
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


@kernel(inline="always")
def _guide_nowhere(c: Record, p: Plants, w: Work, i: int) -> None:
    """Let the row of guidance, where there is one, ask for nothing."""
    last = p.kind.shape[1]
    if p.rows.shape[1] > last:
        guidance_row.insert(w.priority[i, :last], 0, 0, c.through, w.priority[i])
        w.a[i, last, 0], w.a[i, last, 1] = 0.0, 0.0
        w.rows[B, i, last], w.rows[H, i, last], w.rows[ALPHA2_PSI, i, last] = -1.0, 0.0, 0.0


@kernel(inline="always")
def _conclude(c: Record, drives: Drives, p: Plants, w: Work, i: int) -> None:
    """Write what the report says of one plant."""
    plant = p.sensed[i]
    told = p.told[i]
    m = p.kind.shape[1]
    u = w.answer.u[i]
    if _stops(told.reason, c.brakes):
        unsure = told.reason < ALARM or told.reason == MOTION or told.reason == RESPONSE
        if unsure and told.reason != GOAL:
            _apply(w, i)
        w.answer.status[i] = BACKUP
    furthest = change2 = asked2 = 0.0
    for j in range(told.u_nominal.size):  # known to the compiler
        if c.rounding > 0.0:
            u[j] = np.float32(u[j])
        change = u[j] - told.u_nominal[j]
        furthest = max(furthest, abs(change))
        change2 += change * change
        asked2 += told.u_nominal[j] ** 2
        told.u_safe[j] = plant.input[j] = u[j]
    slack, delta = w.answer.slack[i], w.answer.delta[i]
    h, psi = w.rows[H, i, :m], w.rows[PSI, i, :m]
    told.proved = 0
    violated = False
    believed = told.reason == 0 or told.reason >= ALARM or told.reason == GOAL
    if believed:
        alpha1 = c.rows[ALPHA1 : ALPHA1 + 4]
        of_rows = h, w.margin[0, i], w.margin[LEANING, i], psi
        short = verdict.shortfall(w.strict[i], *of_rows, c.dip, c.sway, alpha1)
        violated = verdict.is_violated(plant, short, plant.elapsed, c.settles)
        told.proved = 0 if verdict.lacks(short) else 1
    unsafe = False
    if drives is not None:
        for k in range(m):
            violated |= p.priority[i, k] == 1 and slack[k] > 0.0
        axle = axle_step.place(c, plant)
        h_body = axle_step.of_body(c, p, i, h, w.strict[i])
        for k in range(m):
            reach = c.body if w.strict[i, k] else 0.0  # a is not ∇h
            limit = p.parameters[i, k, layout.V_MAX]
            out = h_body[k] < reach
            out |= verdict.speeds(p.kind[i, k], limit, h[k], axle.x, axle.lag)
            unsafe |= out and p.priority[i, k] == 1
    elif c.made:
        for k in range(m):
            reach = p.own[i, k, REACH] if w.strict[i, k] else 0.0
            out = h[k] < reach or p.own[i, k, FAST] != 0.0
            unsafe |= out and p.priority[i, k] == 1
    else:
        for k in range(m):
            reach = 0.0
            if c.body > 0.0 and w.strict[i, k]:
                reach = c.body * np.sqrt(w.a[i, k, 0] ** 2 + w.a[i, k, 1] ** 2)
            limit = p.parameters[i, k, layout.V_MAX]
            out = h[k] < reach
            out |= verdict.speeds(p.kind[i, k], limit, h[k], plant.x, plant.lag)
            unsafe |= out and p.priority[i, k] == 1
    moved = furthest > NOMINAL * (1.0 + c.radius)
    told.status = verdict.conclude(w.answer.status[i], moved, unsafe, violated, slack[:m])
    told.intervention = np.sqrt(change2)
    told.fallbacks = w.answer.fallbacks[i]
    told.deadlock = verdict.stands(plant.x[2] ** 2 + plant.x[3] ** 2, asked2)
    for k in range(m):
        row = p.rows[i, k]
        if p.kind[i, k] == layout.NONE:
            row.slack = row.delta = row.margin = row.conditioning = 0.0
            row.h = row.psi = np.inf
            continue
        row.slack = slack[k]
        row.delta = delta[k]
        row.margin = w.margin[0, i, k]
        row.h = h[k] if believed else np.nan
        row.psi = psi[k] if believed else np.nan
        row.conditioning = 0.0
        own = p.own.size > 0 and p.kind[i, k] == layout.CUSTOM
        if own:
            row.margin += p.own[i, k, DIP]
        if believed and c.made:
            row.conditioning = p.own[i, k, CONDITIONING]
        elif believed and (w.a[i, k, 0] != 0.0 or w.a[i, k, 1] != 0.0):
            row.conditioning = 1.0


@kernel(inline="always")
def _apply(w: Work, i: int) -> None:
    """Make the braking input the answer, as it is: the rows say nothing, or no solver answered.

    After an alarm, and where guidance finds no path, the state is believed: braking may bring the
    plant to a region, and the program's answer to the braking input keeps it away.
    """
    put(w.answer.u[i], w.u[i])
    w.answer.slack[i, :], w.answer.delta[i, :] = 0.0, 0.0
    w.answer.fallbacks[i] = 0
