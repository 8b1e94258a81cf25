"""What a compiled filter reads and writes: constants, plants, and room for the rows of a few."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.arrays import Array, Integers, Records
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.rows import SETTINGS_WIDTH
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.programs.planar.records import Settings, Workspace, make_workspace
from hcbf_gym.programs.result import FilterResult

CONSTANTS = np.dtype(
    (
        np.record,
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
            ("corners", "i8"),  # of U
            ("weights", "i8"),  # of a state
            # what the rows keep, and how they are made
            *((name, "f8") for name in Uncertainty._fields),
            ("rows", "f8", SETTINGS_WIDTH),  # `RowSettings.packed`
            ("period", "f8"),  # T [s], 0 where it is not known
            ("rounding", "f8"),  # of an input that is told in 32 bits, 0 for 64 [m/s²]
            ("dip", "f8"),  # what usual rows reserve against dips between samples
            ("sway", "f8"),  # what of d a robot may use that is not its model
            ("settles", "f8"),  # how long the robot takes to follow [s], 0 for its model
            # guidance
            ("has_way", "?"),
            ("through", "i8"),  # the highest rank that gives way to guidance, 0 for none
            ("brakes", "?"),  # whether an alarm makes the filter brake
        ],
    )
)
"""What a filter never changes."""


LEAST_PLANTS = 64
"""Below so many plants a thread takes longer to begin than to filter."""


def constants(settings: Settings, others: dict[str, Any]) -> tuple[Records, Array]:
    """Return (1,) `CONSTANTS`, and the corners of U with the program's weights behind them.

    Args:
        settings: of the program.
        others: the rest of the constants, by their names.
    """
    record = np.zeros(1, dtype=CONSTANTS)
    own = settings._asdict()
    vertices, weights = own.pop("vertices"), own.pop("weights")
    sizes = {"corners": len(vertices), "weights": weights.shape[1]}
    for name, number in (own | sizes | others).items():
        record[name] = number
    return record, _numbers(vertices, weights)


def divided(settings: Settings, count: int, threads: int) -> list[tuple[slice, Array]]:
    """Return parts of N plants for so many threads, each with what `constants` returns second.

    Args:
        settings: of the program.
        count: N.
        threads: of which each gets at least `LEAST_PLANTS`.
    """
    parts = max(1, min(threads, count // LEAST_PLANTS))
    ends = np.linspace(0, count, parts + 1).astype(int).tolist()
    found: list[tuple[slice, Array]] = []
    for part in (slice(*pair) for pair in pairwise(ends)):
        own = settings.weights[part] if len(settings.weights) > 1 else settings.weights
        found.append((part, _numbers(settings.vertices, own)))
    return found


def _numbers(vertices: Array, weights: Array) -> Array:
    """Return the corners of U with the program's weights behind them."""
    return np.concatenate([vertices.ravel(), weights.ravel()])


_OWN = "a_x", "a_y", "b", "h", "alpha2_psi", "psi", "margin", "dip"
OWN_ROW = np.dtype((np.record, [(name, "f8") for name in _OWN]))
"""A row of a user's own barrier, made in Python: `own_rows.OwnRow`, and its margin."""


class Plants(NamedTuple):
    """N plants, their scenes, and what is said of them.

    Attributes:
        kind: (N, m) of the scenes, as `BarrierSet` holds it.
        parameters: (N, m, WIDTH) likewise.
        priority: (N, m) likewise.
        own_margin: (N, m) likewise.
        atlas: (L,) where the pieces of maps stand; of length 1 where there is no map.
        sensed: (N,) `planar_belief.PLANT`, written to.
        own: (N, m) `OWN_ROW` where users' own rows were made beforehand, else (0, 0).
        told: (N,) `report.PLANT`, with u*; the rest is written.
        rows: (N, M) `report.ROW`, written to; M is m, and one more where guidance has a row.
    """

    kind: Integers
    parameters: Array
    priority: Integers
    own_margin: Array
    atlas: Array
    sensed: Records
    own: Records
    told: Records
    rows: Records


class Work(NamedTuple):
    """Room for the rows of a few plants, n at most, and for the program's answers.

    Attributes:
        u: (n, 2) the inputs that the program is asked for.
        a: (n, M, 2) gradients.
        rows: (4, n, M) b, h, α₂(ψ) and ψ.
        priority: (n, M).
        margin: (4, n, m) as `margins.derive` writes them.
        strict: (n, m) which conditions are of rank 1 and on the position.
        answer: of the program, with a leading n.
        polygons: the program's own.
    """

    u: Array
    a: Array
    rows: Array
    priority: Integers
    margin: Array
    strict: NDArray[np.bool_]
    answer: FilterResult
    polygons: Workspace


@njit(cache=True, inline="always")
def fits(p: Plants) -> bool:
    """Tell whether the scenes are of as many plants and rows as there is room for, in sound ranks.

    Nothing else here checks an index.
    """
    count, m = p.kind.shape
    if p.sensed.size != count or p.told.size != count or p.rows.shape[0] != count:
        return False
    if p.rows.shape[1] < m or (p.own.size > 0 and p.own.shape != (count, m)):
        return False
    if p.parameters.shape != (count, m, layout.WIDTH):
        return False
    if p.priority.shape != (count, m) or p.own_margin.shape != (count, m):
        return False
    for i in range(count):
        for k in range(m):
            if not 1 <= p.priority[i, k] <= layout.LOWEST_RANK:
                return False
    return True


@njit(cache=True, inline="always")
def make_work(settings: Settings, n: int, m: int, total: int) -> Work:
    """Return room for n plants with m rows, `total` with guidance."""
    return Work(
        np.empty((n, 2)),
        np.empty((n, total, 2)),
        np.empty((4, n, total)),
        np.empty((n, total), dtype=np.int64),
        np.empty((4, n, m)),
        np.empty((n, m), dtype=np.bool_),
        FilterResult(
            np.empty((n, 2)),
            np.empty((n, total)),
            np.empty((n, total)),
            np.empty(n, dtype=np.int64),
            np.empty(n, dtype=np.int64),
        ),
        make_workspace(settings.radius, settings.vertices.shape[0], total),
    )


@njit(cache=True, inline="always")
def program_of(c: Any, numbers: Array, first: int, end: int) -> Settings:
    """Return the program of the plants from `first` on and before `end`, with their weights."""
    weights = numbers[2 * c.corners :].reshape(-1, c.weights)
    if weights.shape[0] > 1:  # each plant has its own
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
        numbers[: 2 * c.corners].reshape(c.corners, 2),
        weights,
    )


@njit(cache=True, inline="always")
def some(p: Plants, first: int, end: int) -> Plants:
    """Return the plants from `first` on and before `end`."""
    return Plants(
        p.kind[first:end],
        p.parameters[first:end],
        p.priority[first:end],
        p.own_margin[first:end],
        p.atlas,
        p.sensed[first:end],
        p.own[first:end],
        p.told[first:end],
        p.rows[first:end],
    )
