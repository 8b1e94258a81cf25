"""The programs of two inputs: one state, or N of them, in one compiled call."""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import InvalidInputError, finite_array
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.cascades import (
    Cascade,
    CbfQp,
    ExplicitHierarchicalCbfQp,
    HierarchicalCbfQp,
    LexicographicCbfQp,
    RelaxedCbfQp,
)
from hcbf_gym.programs.exact.program import filter_exactly
from hcbf_gym.programs.planar import records
from hcbf_gym.programs.planar.cascade import GRADED, filter_batch, filter_state
from hcbf_gym.programs.planar.records import Array, Settings
from hcbf_gym.programs.program import Program, check_shapes, explain, well_formed
from hcbf_gym.programs.result import FilterResult, FilterStatus

KINDS: dict[type[Cascade], int] = {
    CbfQp: records.CBF,
    RelaxedCbfQp: records.RELAXED,
    HierarchicalCbfQp: records.HIERARCHICAL,
    ExplicitHierarchicalCbfQp: records.EXPLICIT,
    LexicographicCbfQp: records.LEXICOGRAPHIC,
}
"""The programs that are compiled for two inputs; others, such as a user's own, are not."""
_STATUS = {int(status): status for status in FilterStatus}
_MALFORMED = -2


def settings_of(cascade: Cascade, input_set: InputSet) -> Settings:
    """Return what the kernels must know of a program.

    Raises:
        InvalidInputError: if the input set is not planar, or the program is not among `KINDS`.
    """
    if type(cascade) not in KINDS:
        raise InvalidInputError(
            f"program: got {type(cascade).__name__}, which is not compiled for two inputs, "
            f"expected one of {sorted(kind.__name__ for kind in KINDS)}: filter single states "
            "with solver='daqp'"
        )
    if input_set.n_u != 2:
        raise InvalidInputError(
            f"batch: got {input_set.n_u} inputs, expected 2: use the single program"
        )
    known = isinstance(cascade, RelaxedCbfQp) and cascade.epsilon == "known"
    return Settings(
        KINDS[type(cascade)],
        input_set.radius,
        cascade.lambda_u,
        known,
        np.ascontiguousarray(input_set.vertices()),
        np.ascontiguousarray(cascade.weights.table),
    )


class PlanarProgram(Program):
    """A program of two inputs for a single state.

    No solver is called: feasible sets are polygons, cut and searched exactly. The few states with
    a stage whose rows differ too much in steepness go to rational arithmetic.

    Attributes:
        settings: the program as `planar.cascade` reads it.
    """

    def __init__(self, cascade: Cascade, input_set: InputSet) -> None:
        super().__init__(cascade, input_set)
        cascade.weights.check(1)
        self.settings = settings_of(cascade, input_set)
        self._arguments = tuple(self.settings)

    def __call__(self, u_nominal: ArrayLike, rows: CbfRows) -> FilterResult:
        """Filter one nominal input; see :class:`Program`."""
        desired = np.ascontiguousarray(u_nominal) if _is_pair(u_nominal) else None
        if desired is None:
            desired = finite_array("u_nominal", u_nominal, (2,))
        a, b, h, priority, alpha2_psi = _arrays(self.cascade, rows)
        m = b.size
        if not (a.shape == (m, 2) and b.shape == h.shape == priority.shape == alpha2_psi.shape):
            check_shapes(rows, 2)
            raise InvalidInputError(f"rows.b: got shape {b.shape}, expected (m,): one state")
        answer = np.empty(2 + 2 * m)
        u, slack, delta = answer[:2], answer[2 : 2 + m], answer[2 + m :]
        status = _filter_one(self._arguments, desired, a, b, h, priority, alpha2_psi, answer)
        if status == _MALFORMED:
            finite_array("u_nominal", desired, (2,))
            explain(rows)
        if status == GRADED:
            return filter_exactly(self.cascade, self.input_set, desired, rows)
        return FilterResult(u, slack, delta, _STATUS[status], 0)


class BatchProgram:
    """The same filter as a single program of two inputs, for N states at once.

    Args:
        cascade: what is solved.
        input_set: U.

    Raises:
        InvalidInputError: if it has not two inputs.
    """

    def __init__(self, cascade: Cascade, input_set: InputSet) -> None:
        self.cascade = cascade
        self.input_set = input_set
        self.settings = settings_of(cascade, input_set)
        self._arguments = tuple(self.settings)

    def __call__(self, u_nominal: ArrayLike, rows: CbfRows) -> FilterResult:
        """Filter N nominal inputs.

        Args:
            u_nominal: (N, 2) u*, inside U or not.
            rows: the rows of N states, each array with a leading N; m is the same for all.

        Returns:
            The result with a leading N; `status` and `fallbacks` are (N,) integers.

        Raises:
            InvalidInputError: on malformed input or rows.
        """
        desired = finite_array("u_nominal", u_nominal, (None, 2))
        count = len(desired)
        if rows.b.ndim != 2 or rows.b.shape[0] != count:
            raise InvalidInputError(f"rows.b: got shape {rows.b.shape}, expected ({count}, m)")
        check_shapes(rows, 2)
        self.cascade.weights.check(count)
        answer = FilterResult(
            np.empty_like(desired),
            np.empty(rows.b.shape),
            np.empty(rows.b.shape),
            np.empty(count, dtype=np.int64),
            np.empty(count, dtype=np.int64),
        )
        arrays = _arrays(self.cascade, rows)
        if not _filter_all(self._arguments, desired, arrays, tuple(answer)):
            explain(rows)
        finish(self, desired, rows, answer)
        return answer


def finish(
    program: "PlanarProgram | BatchProgram", u_nominal: Array, rows: CbfRows, answer: FilterResult
) -> None:
    """Solve in rational arithmetic the states that `filter_batch` has left to it.

    Args:
        program: whose settings it was called with.
        u_nominal: (N, 2) u*.
        rows: the rows of N states.
        answer: what `filter_batch` wrote; its `GRADED` states are replaced.
    """
    for i in np.flatnonzero(answer.status == GRADED):
        one = CbfRows(*(field[i] for field in rows if field is not None))
        alone = filter_exactly(program.cascade, program.input_set, u_nominal[i], one, int(i))
        for many, single in zip(answer, alone, strict=True):
            many[i] = single


def _is_pair(u: ArrayLike) -> bool:
    """Tell whether u* is what the kernel reads, so that nothing needs to be looked at again."""
    return type(u) is np.ndarray and u.shape == (2,) and u.dtype == np.float64


def _arrays(cascade: Cascade, rows: CbfRows) -> tuple[Array, Array, Array, NDArray, Array]:
    """Return the rows' arrays as the kernels read them; b stands in for an α₂(ψ) nobody reads.

    Raises:
        InvalidInputError: if the program reads α₂(ψ) and there is none.
    """
    if rows.alpha2_psi is None:
        cascade.least_slack(rows)
    if rows.priority.dtype.kind not in "iu":
        check_shapes(rows, 2)
    return (
        np.ascontiguousarray(rows.a, np.float64),
        np.ascontiguousarray(rows.b, np.float64),
        np.ascontiguousarray(rows.h, np.float64),
        np.ascontiguousarray(rows.priority, np.int64),
        np.ascontiguousarray(rows.b if rows.alpha2_psi is None else rows.alpha2_psi, np.float64),
    )


@njit(cache=True)
def _filter_one(
    settings: tuple[Any, ...],
    u_nominal: Array,
    a: Array,
    b: Array,
    h: Array,
    priority: NDArray[np.int64],
    alpha2_psi: Array,
    answer: Array,
) -> int:
    """Filter one state: check it, and write u, slack and δ one after the other.

    Arrays come one by one: Numba takes a microsecond to open a record that Python hands over.
    """
    finite = np.isfinite(u_nominal).all() and np.isfinite(alpha2_psi).all()
    if not finite or not well_formed(a, b, h, priority):
        return _MALFORMED
    m = b.size
    rows = CbfRows(a, b, h, priority, alpha2_psi)
    u, slack, delta = answer[:2], answer[2 : 2 + m], answer[2 + m :]
    return filter_state(Settings(*settings), u_nominal, rows, u, slack, delta)


@njit(cache=True)
def _filter_all(
    settings: tuple[Any, ...],
    u_nominal: Array,
    rows: tuple[Any, ...],
    answer: tuple[Any, ...],
) -> bool:
    """Filter N states, unless a row is malformed; tell whether none is."""
    a, b, h, priority, alpha2_psi = rows
    if not np.isfinite(alpha2_psi).all():
        return False
    for i in range(b.shape[0]):
        if not well_formed(a[i], b[i], h[i], priority[i]):
            return False
    filter_batch(Settings(*settings), u_nominal, CbfRows(*rows), FilterResult(*answer))
    return True
