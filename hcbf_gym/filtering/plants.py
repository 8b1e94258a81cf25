"""What compiled code reads and writes: constants, plants, and room for the rows of a few."""

from functools import cache
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.arrays import Array, Integers, Record, Records
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.rows import SETTINGS_WIDTH
from hcbf_gym.compilation import kernel
from hcbf_gym.filtering import monitor, verdict
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.programs.planar.records import Settings, Workspace, make_workspace
from hcbf_gym.programs.result import FilterResult

Drives = Literal[True] | None
"""None of points, for which Numba then compiles nothing of an axle; True of robots with one."""

CONSTANTS = np.dtype(
    (
        np.record,
        np.dtype(
            [
                # the program, as `planar.records.Settings` has it
                ("lower", "i8"),
                ("by_level", "?"),
                ("lock", "i8"),
                ("ranks", "?"),
                ("guided", "?"),
                ("radius", "f8"),
                ("lambda_u", "f8"),
                ("known_offset", "?"),
                ("corners", "i8"),  # of a U
                ("input_sets", "i8"),  # 1, or one a plant
                ("weights", "i8"),  # of a state
                ("made", "?"),  # whether rows, alarms and braking inputs were made beforehand
                # what the rows keep, and how they are made
                *((name, "f8") for name in Uncertainty._fields),
                ("rows", "f8", SETTINGS_WIDTH),  # `RowSettings.packed`
                ("period", "f8"),  # T [s], 0 where it is not known
                ("rounding", "f8"),  # of an input that is told in 32 bits, 0 for 64 [m/s²]
                ("dip", "f8"),  # what usual rows reserve against dips between samples
                ("sway", "f8"),  # what of d a robot may use that is not its model
                ("settles", "f8"),  # how long the robot takes to follow [s], 0 for its model
                # a differential drive
                ("drives", "?"),
                ("axle", "f8", 4),  # `models.axle.Axle`
                ("axle_rows", "f8", SETTINGS_WIDTH),  # `RowSettings.packed` of rows on the axle
                ("jerk", "f8"),  # what these reserve of the acceleration [m/s²]
                # guidance
                ("has_way", "?"),
                ("through", "i8"),  # the highest rank that gives way to guidance, 0 for none
                ("brakes", "?"),  # whether an alarm makes the filter brake
                ("observed", "?"),  # whether states were measured, and are compared here
            ],
            align=True,  # so that it is made of whole numbers
        ),
    )
)
"""What a filter never changes."""


@cache
def plant_dtype(n_u: int) -> np.dtype[np.void]:
    """Return what is known of one plant of so many inputs; zeros at a reset.

    Vectors of length 4 are those of the planar double integrator. Those of other models stand
    beside the record, see `belief.State`.
    """
    fields: list[tuple[object, ...]] = [
        # what is said of it now, as `models.plant.Estimate` has it
        ("x", "f8", 4),
        ("time", "f8"),
        ("model", "f8", 4),
        ("lag", "f8", 4),
        ("covariance", "f8", (4, 4)),
        ("elapsed", "f8"),  # since the sample before [s]; 0 where that is not known
        ("fault", "i8"),  # a `Reason` that was found on the way here; 0 for none
        ("has_model", "i8"),  # whether the model has a state of its own; x is that if not
        ("heading", "f8"),  # of a differential drive [rad]
        # where guidance leads
        ("way", "f8", 3),  # a_x, a_y and b of its row
        ("turns", "i8"),  # whether a differential drive turns to it, against u*
        ("turn", "f8"),  # by which acceleration across its heading then [m/s²]
        ("reachable", "f8"),  # through which rank
        ("lost", "i8"),  # whether it finds no path to the goal
        ("zone", "f8"),  # the rank of the map's zone that it stands in, 0 for none
        # what is remembered from step to step
        *monitor.MEMORY,
        *monitor.PLANAR_MEMORY,
        ("expected", "f8", 2),  # velocity of the model at the last sample [m/s]
        ("vague", "f8", 3),  # xx, xy and yy of its covariance at the last sample [m²/s²]
        ("growth", "f8"),  # what that grew by when it grew last [m²/s²]
        ("believed", "f8", 4),  # the last state that was
        ("headed", "f8"),  # the heading then [rad]
        ("believed_at", "f8"),  # its time [s]
        ("follows", "i8"),  # whether the last sample was believed
        ("known", "i8"),  # whether any was, since the reset
        *verdict.MEMORY,
        ("alarm", "i8"),  # a `Reason`, until the next reset
        ("moves", "i8"),  # whether a region is nearer than its velocity explains
        ("input", "f8", (n_u,)),  # applied since the last sample
        ("stop", "f8", (n_u,)),  # of U, brings a plant of another model to rest
    ]
    return np.dtype((np.record, fields))


PLANT = plant_dtype(2)
"""What is known of one plant of two inputs."""


LEAST_PLANTS = 64
"""Below so many plants a thread takes longer to begin than to filter."""


def constants(settings: Settings, others: dict[str, object]) -> tuple[Array, Array]:
    """Return the numbers of a `CONSTANTS`; and the corners of U, the program's weights behind them.

    Args:
        settings: of the program.
        others: the rest of the constants, by their names.
    """
    record = np.zeros(1, dtype=CONSTANTS)
    own = settings._asdict()
    vertices, weights = own.pop("vertices"), own.pop("weights")
    sizes = {"corners": vertices.shape[1], "input_sets": 1, "weights": weights.shape[1]}
    for name, number in (own | sizes | others).items():
        record[name] = number
    return record.view(np.float64), _numbers(vertices, weights)


def solved_outside(radius: float) -> Settings:
    """Return the settings of a program that a solver outside answers.

    Args:
        radius: the largest norm of an input.
    """
    nothing = np.zeros((1, 1, 2)), np.zeros((1, 1))
    return Settings(0, False, 0, True, False, radius, 0.0, False, *nothing)


def parts_of(count: int, threads: int) -> list[slice]:
    """Return parts of N plants for so many threads, of which each gets at least `LEAST_PLANTS`."""
    parts = max(1, min(threads, count // LEAST_PLANTS))
    ends = np.linspace(0, count, parts + 1).astype(int).tolist()
    return [slice(*pair) for pair in pairwise(ends)]


def part_of(constants: Records, program: Array, part: slice) -> Array:
    """Return the corners of U and the weights of a part of N plants, as `constants` does of all."""
    one = constants[0]
    vertices, weights = split(one, program)
    own = (array if len(array) == 1 else array[part] for array in (vertices, weights))
    return _numbers(*own)


def with_vertices(constants: Records, program: Array, vertices: Array) -> Array:
    """Return a program for the U of each plant, (N, V, 2) corners; the constants are written to."""
    _, weights = split(constants[0], program)
    constants["input_sets"], constants["corners"] = vertices.shape[:2]
    return _numbers(vertices, weights)


def _numbers(vertices: Array, weights: Array) -> Array:
    """Return the corners of U with the program's weights behind them."""
    return np.concatenate([vertices.ravel(), weights.ravel()])


class Plants(NamedTuple):
    """N plants, their scenes, and what is said of them.

    Attributes:
        kind: (N, m) of the scenes, as `BarrierSet` holds it.
        parameters: (N, m, WIDTH) likewise.
        priority: (N, m) likewise.
        own_margin: (N, m) likewise.
        sensed: (N,) `PLANT`, written to.
        own: (N, m, WIDTH + n_u) rows that were made beforehand, see `barriers.general_kernels`;
            (0, 0, 0) where there are none.
        told: (N,) `report.PLANT`, with u*; the rest is written.
        rows: (N, M) `report.ROW`, written to; M is m, and one more where guidance has a row.
    """

    kind: Integers
    parameters: Array
    priority: Integers
    own_margin: Array
    sensed: Records
    own: Array
    told: Records
    rows: Records


class Work(NamedTuple):
    """Room for the rows of a few plants, n at most, and for the program's answers.

    Attributes:
        u: (n, n_u) the inputs that the program is asked for.
        a: (n, M, n_u) gradients.
        rows: (4, n, M) b, h, α₂(ψ) and ψ.
        priority: (n, M).
        margin: (4, n, m) as `margins.derive` writes them.
        strict: (n, m) which conditions are of rank 1 and on the position.
        straight: (n, M, 3) a and b of the rows on the acceleration, of differential drives; n is 0
            for all others.
        answer: of the program, with a leading n.
        polygons: the program's own.
    """

    u: Array
    a: Array
    rows: Array
    priority: Integers
    margin: Array
    strict: NDArray[np.bool_]
    straight: Array
    answer: FilterResult
    polygons: Workspace


@kernel(inline="always")
def fits(p: Plants, led: bool) -> bool:
    """Tell whether the scenes are of as many plants and rows as there is room for, in sound ranks.

    Nothing else here checks an index.

    Args:
        p: the plants.
        led: whether guidance has a row of its own.
    """
    count, m = p.kind.shape
    if p.sensed.size != count or p.told.size != count or p.rows.shape[0] != count:
        return False
    if p.rows.shape[1] < m + led or (p.own.size > 0 and p.own.shape[:2] != (count, m)):
        return False
    if p.parameters.shape != (count, m, layout.WIDTH):
        return False
    if p.priority.shape != (count, m) or p.own_margin.shape != (count, m):
        return False
    for i in range(count):
        for k in range(m):
            if p.kind[i, k] == layout.NONE:
                if p.priority[i, k] != 0:
                    return False
            elif not 1 <= p.priority[i, k] <= layout.LOWEST_RANK:
                return False
    return True


@kernel(inline="always")
def make_work(
    settings: Settings, n: int, m: int, total: int, n_u: int, drives: Drives = None
) -> Work:
    """Return room for n plants of n_u inputs with m rows, `total` with guidance.

    What lies together is one piece of memory: asking for it takes as long as filling it.
    """
    of_inputs, of_rows = np.empty((2, n, n_u)), np.empty((6, n, total))
    codes = np.empty(n * (total + 2), dtype=np.int64)
    ends = n * total, n * (total + 1)
    return Work(
        of_inputs[0],
        np.empty((n, total, n_u)),
        of_rows[:4],
        codes[: ends[0]].reshape(n, total),
        np.empty((4, n, m)),
        np.empty((n, m), dtype=np.bool_),
        np.empty((n if drives is not None else 0, total, 3)),
        FilterResult(
            of_inputs[1],
            of_rows[4],
            of_rows[5],
            codes[ends[0] : ends[1]],
            codes[ends[1] :],
        ),
        make_workspace(settings.radius, settings.vertices.shape[1], total),
    )


@kernel(inline="always")
def split(c: Record, numbers: Array) -> tuple[Array, Array]:
    """Return the corners of U (K, V, 2) and the weights (K, 1 + L) of a program."""
    end = 2 * c.corners * c.input_sets
    return numbers[:end].reshape(c.input_sets, c.corners, 2), numbers[end:].reshape(-1, c.weights)


@kernel(inline="always")
def program_of(c: Record, numbers: Array, first: int, end: int) -> Settings:
    """Return the program of the plants from `first` on and before `end`, with what is their own."""
    vertices, weights = split(c, numbers)
    if vertices.shape[0] > 1:  # each plant has its own
        vertices = vertices[first:end]
    if weights.shape[0] > 1:
        weights = weights[first:end]
    return Settings(
        c.lower,
        c.by_level,
        c.lock,
        c.ranks,
        c.guided,
        c.radius,
        c.lambda_u,
        c.known_offset,
        vertices,
        weights,
    )


@kernel(inline="always")
def some(p: Plants, first: int, end: int) -> Plants:
    """Return the plants from `first` on and before `end`."""
    return Plants(
        p.kind[first:end],
        p.parameters[first:end],
        p.priority[first:end],
        p.own_margin[first:end],
        p.sensed[first:end],
        p.own[first:end],
        p.told[first:end],
        p.rows[first:end],
    )
