"""From u* to u in one compiled call: margins, rows, guidance, program, status, for N plants."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.barriers import layout, margins, row_kernels
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.compilation import borrowed
from hcbf_gym.guidance import row as guidance_row
from hcbf_gym.guidance.row import Pull
from hcbf_gym.models.constants import ASKING, STANDING
from hcbf_gym.models.plant import Reason, Uncertainty
from hcbf_gym.programs.planar.cascade import filter_range
from hcbf_gym.programs.planar.polygon import nearest
from hcbf_gym.programs.planar.records import Settings, make_workspace
from hcbf_gym.programs.result import FilterResult, FilterStatus
from hcbf_gym.programs.tolerances import NOMINAL
from hcbf_gym.wrappers.senses import Sensed, look, watch

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

DONE, NOT_FINITE, MISSHAPED, ASKS = range(4)
"""What a call says of itself."""

TOGETHER = 32
"""Plants that go through the filter together: few enough for a core's first cache."""

NOMINAL_INPUT, SAFE = int(FilterStatus.NOMINAL), int(FilterStatus.SAFE)
UNSAFE, BACKUP = int(FilterStatus.UNSAFE), int(FilterStatus.BACKUP)
BARRIERS, MOTION = int(Reason.BARRIERS), int(Reason.MOTION)

STATUS, REASON = range(2)
"""The rows of a call's codes (2, N)."""


Numbers8 = tuple[float, float, float, float, float, float, float, float]
Constants = tuple[
    tuple[int, bool, int, bool, bool, float, float, bool, Array, Array],
    Array,
    Numbers8,
    float,
    int,
    tuple[float, float, float, float],
    bool,
]
"""`planar.records.Settings`, `RowSettings.packed`, `models.plant.Uncertainty`, the period T [s] (0
where it is not known), the highest rank that gives way to guidance (0 for none),
`guidance.row.Pull`, and whether an alarm makes the filter brake."""


class Scene(NamedTuple):
    """The barriers of N scenes, as `BarrierSet` holds them."""

    kind: Integers
    parameters: Array
    priority: Integers
    own_margin: Array


class Way(NamedTuple):
    """What guides N plants.

    Attributes:
        field: (N, capacity) as `guidance.Geodesic` holds it; no cells means no field.
        through: (N, capacity) likewise.
        geometry: (N, 5) likewise.
        goal: (N, 2) [m].
        row: (N, 3) a_x, a_y and b of guidance rows made beforehand; (0, 3) for none.
    """

    field: NDArray[np.float32]
    through: NDArray[np.int8]
    geometry: Array
    goal: Array
    row: Array


class Work(NamedTuple):
    """The rows of the call.

    Attributes:
        a: (N, M, 2) gradients; M is m, and one more with guidance.
        rows: (4, N, M) b, h, α₂(ψ) and ψ.
        priority: (N, M).
        margin: (2, N, m) margins and their rates.
        u: (N, 2) the inputs that the program was asked for.
    """

    a: Array
    rows: Array
    priority: Integers
    margin: Array
    u: Array


class Answer(NamedTuple):
    """What a call writes, all in one array; see `answer_views`.

    Attributes:
        u: (N, 2).
        slack: (N, M).
        delta: (N, M).
        margin: (N, m).
        intervention: (N,) ‖u − u*‖.
        fallbacks: (N,).
        model_error: (N,).
        reachable: (N,).
        deadlock: (N,) 1 where the plant stands though u* asks it to move, else 0.
    """

    u: Array
    slack: Array
    delta: Array
    margin: Array
    intervention: Array
    fallbacks: Array
    model_error: Array
    reachable: Array
    deadlock: Array


def answer_size(count: int, m: int, total: int) -> int:
    """Return how many numbers an answer of N plants with m rows, or M with guidance, takes."""
    return count * (2 + 2 * total + m + 5)


@njit(cache=True)
def answer_views(flat: Array, count: int, m: int, total: int) -> Answer:
    """Return the parts of an answer's array (answer_size,)."""
    ends = np.cumsum(count * np.array([2, total, total, m, 1, 1, 1, 1, 1]))
    return Answer(
        flat[: ends[0]].reshape(count, 2),
        flat[ends[0] : ends[1]].reshape(count, total),
        flat[ends[1] : ends[2]].reshape(count, total),
        flat[ends[2] : ends[3]].reshape(count, m),
        flat[ends[3] : ends[4]],
        flat[ends[4] : ends[5]],
        flat[ends[5] : ends[6]],
        flat[ends[6] : ends[7]],
        flat[ends[7] : ends[8]],
    )


@njit(cache=True)
def filter_plants(
    constants: Constants,
    scene: tuple[Integers, Array, Integers, Array],
    sensed: tuple[Array, Array, Array, Array, Array, Integers],
    way: tuple[NDArray[np.float32], NDArray[np.int8], Array, Array, Array],
    work: tuple[Array, Array, Integers, Array, Array],
    memory: NDArray[np.void],
    u_nominal: Array,
    flat: Array,
    codes: Integers,
    given: bool,
) -> int:
    """Filter the nominal inputs of N planar double integrators; see the records for the parts.

    Args:
        constants: what a filter never changes.
        scene: `Scene`.
        sensed: `senses.Sensed`; what is not believed is replaced.
        way: `Way`.
        work: `Work`, written to.
        memory: (N,) `senses.MEMORY`, written to.
        u_nominal: (N, 2) u*.
        flat: (answer_size,) written to.
        codes: (2, N) the statuses and the reasons, written to; where `given`, the reasons stand
            there already.
        given: whether the states were looked at, and the rows and margins stand in `work`.

    Returns:
        `DONE`; `NOT_FINITE` (u* is not) or `MISSHAPED` (a scene is not of N plants), and nothing is
        written; or `ASKS` where there is a reason to speak.
    """
    program, row_settings, uncertainty, period, through, pull, brakes = borrowed(constants)
    barriers, plants = Scene(*borrowed(scene)), Sensed(*borrowed(sensed))
    fields, w = Way(*borrowed(way)), Work(*borrowed(work))
    memory, u_nominal, flat = borrowed(memory), borrowed(u_nominal), borrowed(flat)
    codes = borrowed(codes)
    if not np.isfinite(u_nominal).all():
        return NOT_FINITE
    if not _fits(barriers, plants, w):
        return MISSHAPED
    settings, known, asks = Settings(*program), Uncertainty(*uncertainty), False
    count, total = w.priority.shape
    answer = answer_views(flat, count, barriers.kind.shape[1], total)
    status, reason = codes[STATUS], codes[REASON]
    fallbacks = np.empty(count, dtype=np.int64)
    rows = CbfRows(w.a, w.rows[0], w.rows[1], w.priority, w.rows[2])
    result = FilterResult(answer.u, answer.slack, answer.delta, status, fallbacks)
    polygons = make_workspace(settings.radius, settings.vertices.shape[0], total)
    for first in range(0, count, TOGETHER):
        end = min(first + TOGETHER, count)
        if not given:
            for i in range(first, end):
                reason[i] = look(memory[i], plants, i, period)
            _make_rows(first, end, row_settings, known, barriers, plants, w)
        for i in range(first, end):
            if not _are_finite(w, i) and reason[i] == 0:
                reason[i] = BARRIERS
            past, answer.model_error[i] = memory[i], np.sqrt(memory[i].input_error[0])
            if reason[i] == 0:
                answer.model_error[i] = watch(
                    past, plants, i, period, settings.radius, known.confidence
                )
                reason[i] = past.alarm
            else:
                past.follows = 0
            w.u[i, 0], w.u[i, 1], answer.reachable[i] = u_nominal[i, 0], u_nominal[i, 1], 0.0
            if _stops(reason[i], past.alarm, brakes):
                w.u[i, 0], w.u[i, 1] = _braking_input(i, settings, past.known, plants, period)
                _guide_nowhere(i, through, w)
            else:
                answer.reachable[i] = _guide(i, settings, fields, through, Pull(*pull), plants, w)
        filter_range(settings, w.u, rows, result, polygons, first, end)
        for i in range(first, end):
            past = memory[i]
            if _stops(reason[i], past.alarm, brakes):
                _brake(i, reason[i] == past.alarm and reason[i] != MOTION, w, result)
            _conclude(
                i, barriers, plants, u_nominal, result, w, settings.radius, known.body, answer
            )
            past.input[0], past.input[1] = result.u[i, 0], result.u[i, 1]
            asks |= reason[i] != 0
    return ASKS if asks else DONE


@njit(cache=True, inline="always")
def _fits(barriers: Scene, plants: Sensed, w: Work) -> bool:
    """Tell whether the scenes are of as many plants and rows as there is room for, in sound ranks.

    Nothing else here checks an index.
    """
    count, m = barriers.kind.shape
    if w.priority.shape[0] != count or w.margin.shape[2] != m or plants.x.shape[0] != count:
        return False
    if barriers.parameters.shape != (count, m, layout.WIDTH):
        return False
    if barriers.priority.shape != (count, m) or barriers.own_margin.shape != (count, m):
        return False
    for i in range(count):
        for k in range(m):
            if not 1 <= barriers.priority[i, k] <= layout.LOWEST_RANK:
                return False
    return True


@njit(cache=True, inline="always")
def _are_finite(w: Work, i: int) -> bool:
    """Tell whether the safety rows of a state are finite; where they are not, take them out."""
    finite, m = True, w.margin.shape[2]
    for k in range(m):
        finite &= np.isfinite(w.a[i, k, 0] + w.a[i, k, 1] + w.rows[0, i, k] + w.rows[1, i, k])
        finite &= np.isfinite(w.rows[2, i, k] + w.margin[0, i, k])
    if not finite:
        for k in range(m):
            w.a[i, k, 0], w.a[i, k, 1] = 0.0, 0.0
            w.rows[0, i, k], w.rows[1, i, k], w.rows[2, i, k] = -1.0, 1.0, 1.0
            w.margin[0, i, k] = 0.0
    return finite


@njit(cache=True, inline="always")
def _stops(reason: int, alarm: int, brakes: bool) -> bool:
    """Tell whether a plant is brought to rest: it is not known, or an alarm asks for that."""
    return reason != 0 and (reason != alarm or brakes)


@njit(cache=True, inline="always")
def _braking_input(
    i: int, settings: Settings, known: int, plants: Sensed, period: float
) -> tuple[float, float]:
    """Return the input of U nearest ``−v/T``, that nearest 0 where v is not known.

    `DoubleIntegrator.brake` is the same for a single plant.
    """
    wanted_x = wanted_y = 0.0
    if known and period > 0.0:
        wanted_x, wanted_y = -plants.x[i, 2] / period, -plants.x[i, 3] / period
    return nearest(settings.vertices, settings.vertices.shape[0], wanted_x, wanted_y)


@njit(cache=True, inline="always")
def _brake(i: int, rows_hold: bool, w: Work, result: FilterResult) -> None:
    """Make one answer that of a plant that is brought to rest.

    After an alarm the state is believed, but the plant no longer: what it does by itself may bring
    it to a region, and the program's answer to the braking input keeps it away. Without a state
    that is believed the rows say nothing, and the braking input is applied.
    """
    if not rows_hold or result.status[i] < 0:
        result.u[i, 0], result.u[i, 1] = w.u[i, 0], w.u[i, 1]
        result.slack[i, :], result.delta[i, :] = 0.0, 0.0
    result.status[i] = BACKUP


@njit(cache=True, inline="always")
def _make_rows(
    first: int,
    end: int,
    row_settings: Array,
    uncertainty: Uncertainty,
    barriers: Scene,
    plants: Sensed,
    w: Work,
) -> None:
    """Write the margins and the rows of the plants from `first` on and before `end`."""
    for i in range(first, end):
        margins.derive(
            uncertainty,
            barriers.kind[i],
            barriers.parameters[i],
            plants.x[i],
            plants.t[i],
            plants.model[i],
            plants.lag[i],
            plants.covariance[i],
            w.margin[0, i],
            w.margin[1, i],
        )
        for k in range(barriers.priority.shape[1]):
            w.margin[0, i, k] += barriers.own_margin[i, k]
            w.priority[i, k] = barriers.priority[i, k]
    row_kernels.rows(
        barriers.kind[first:end],
        barriers.parameters[first:end],
        w.margin[:, first:end],
        plants.x[first:end],
        plants.t[first:end],
        row_settings,
        w.a[first:end],
        w.rows[:, first:end],
    )


@njit(cache=True, inline="always")
def _guide(
    i: int, settings: Settings, way: Way, through: int, pull: Pull, plants: Sensed, w: Work
) -> int:
    """Let guidance, if there is any, act on one state; return through which rank its way leads.

    A program that has a last rank gets its row, the others' u* is shaped by it.
    """
    rank = 0
    if way.field.shape[1]:
        x = plants.x[i]
        a_x, a_y, b = guidance_row.row(way.field[i], way.geometry[i], way.goal[i], x, pull)
        rank = guidance_row.reachable(way.through[i], way.geometry[i], x[0], x[1])
    elif way.row.shape[0]:
        a_x, a_y, b = way.row[i, 0], way.row[i, 1], way.row[i, 2]
    else:
        return rank
    if not settings.guided:
        w.u[i, 0], w.u[i, 1] = guidance_row.shape(w.u[i, 0], w.u[i, 1], a_x, a_y, b)
        return rank
    last = w.priority.shape[1] - 1
    guidance_row.insert(w.priority[i, :last], rank, through, w.priority[i])
    w.a[i, last, 0], w.a[i, last, 1] = a_x, a_y
    w.rows[0, i, last], w.rows[1, i, last], w.rows[2, i, last] = b, 0.0, 0.0
    return rank


@njit(cache=True, inline="always")
def _guide_nowhere(i: int, through: int, w: Work) -> None:
    """Let the row of guidance, where there is one, ask for nothing."""
    last = w.priority.shape[1] - 1
    if last == w.margin.shape[2]:
        guidance_row.insert(w.priority[i, :last], 0, through, w.priority[i])
        w.a[i, last, 0], w.a[i, last, 1] = 0.0, 0.0
        w.rows[0, i, last], w.rows[1, i, last], w.rows[2, i, last] = -1.0, 0.0, 0.0


@njit(cache=True, inline="always")
def _conclude(
    i: int,
    barriers: Scene,
    plants: Sensed,
    u_nominal: Array,
    result: FilterResult,
    w: Work,
    radius: float,
    body: float,
    answer: Answer,
) -> None:
    """Write what the report says of one state, given the sizes of U [m/s²] and the body [m]."""
    ux, uy = result.u[i, 0], result.u[i, 1]
    dx, dy = ux - u_nominal[i, 0], uy - u_nominal[i, 1]
    answer.intervention[i] = np.sqrt(dx * dx + dy * dy)
    answer.fallbacks[i] = result.fallbacks[i]
    for k in range(barriers.priority.shape[1]):
        answer.margin[i, k] = w.margin[0, i, k]
    m = barriers.priority.shape[1]
    moved = max(abs(dx), abs(dy)) > NOMINAL * (1.0 + radius)
    unsafe = is_unsafe(barriers.kind[i], barriers.priority[i], w.a[i], w.rows[1, i], body)
    result.status[i] = conclude(result.status[i], moved, unsafe, result.slack[i, :m])
    speed2 = plants.x[i, 2] ** 2 + plants.x[i, 3] ** 2
    asked2 = u_nominal[i, 0] ** 2 + u_nominal[i, 1] ** 2
    stands = speed2 < STANDING * STANDING and asked2 > ASKING * ASKING
    answer.deadlock[i] = 1.0 if stands else 0.0


@njit(cache=True)
def is_unsafe(kind: Integers, priority: Integers, a: Array, h: Array, body: float) -> bool:
    """Tell whether a strict ``h − ρ‖∇h‖``, the whole body's where h is a distance, is below zero.

    Args:
        kind: (m,) of the barriers; a speed limit has no place.
        priority: (m,).
        a: (M, 2) of the rows, ∇h; M is m or more.
        h: (M,) of the body's centre.
        body: ρ, what the body reaches beyond its centre [m].
    """
    for k in range(kind.size):
        reach = 0.0
        if body > 0.0 and kind[k] != layout.SPEED_LIMIT:
            reach = body * np.sqrt(a[k, 0] * a[k, 0] + a[k, 1] * a[k, 1])
        if priority[k] == 1 and h[k] < reach:
            return True
    return False


@njit(cache=True)
def conclude(status: int, moved: bool, unsafe: bool, slack: Array) -> int:
    """Return the status of the safety rows alone, and UNSAFE where a strict h is below zero.

    A guidance row that gives way is no violation, and an input that only guidance moved is SAFE.

    Args:
        status: the program's.
        moved: whether u is not u*.
        unsafe: whether a strict h is below zero.
        slack: (m,) of the safety rows.
    """
    if status == BACKUP:
        return status
    if unsafe:
        return UNSAFE
    met = True
    for k in range(slack.size):
        met = met and slack[k] == 0.0
    if met:
        return SAFE if moved else NOMINAL_INPUT
    return status
