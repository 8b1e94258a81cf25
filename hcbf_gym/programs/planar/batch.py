"""Every program for N states at once, in one compiled call."""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import InvalidInputError, finite_array
from hcbf_gym.programs.cbf import CbfQp
from hcbf_gym.programs.explicit import ExplicitHierarchicalCbfQp
from hcbf_gym.programs.hierarchical import HierarchicalCbfQp
from hcbf_gym.programs.lexicographic import LexicographicCbfQp
from hcbf_gym.programs.planar import stages
from hcbf_gym.programs.planar.stages import Workspace
from hcbf_gym.programs.program import Program, check_rows
from hcbf_gym.programs.relaxed import RelaxedCbfQp
from hcbf_gym.programs.result import NOMINAL_TOLERANCE, SLACK_TOLERANCE, FilterResult

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_CBF, _RELAXED, _HIERARCHICAL, _EXPLICIT, _LEXICOGRAPHIC = range(5)
_KINDS: dict[type[Program], int] = {
    CbfQp: _CBF,
    RelaxedCbfQp: _RELAXED,
    HierarchicalCbfQp: _HIERARCHICAL,
    ExplicitHierarchicalCbfQp: _EXPLICIT,
    LexicographicCbfQp: _LEXICOGRAPHIC,
}
GRADED_STATUS = -1
"""What `filter_batch` reports of a state that it leaves to the single program."""


class BatchProgram:
    """The same filter as a single program of two inputs, for N states at once.

    No solver is called: feasible sets are polygons, cut and searched exactly. The few states with
    a stage whose rows differ too much in steepness go to the single program.

    Args:
        program: the single program.

    Raises:
        InvalidInputError: if it has not two inputs.
    """

    def __init__(self, program: Program) -> None:
        if program.input_set.n_u != 2:
            raise InvalidInputError(
                f"batch: got {program.input_set.n_u} inputs, expected 2: use the single program"
            )
        self.program = program
        self._kind = _KINDS[type(program)]
        self._vertices = program.input_set.vertices()

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
        if rows.b.ndim != 2 or rows.b.shape[0] != desired.shape[0]:
            raise InvalidInputError(
                f"rows.b: got shape {rows.b.shape}, expected ({desired.shape[0]}, m)"
            )
        check_rows(rows, 2)
        program = self.program
        u, slack = np.empty_like(desired), np.empty_like(rows.b)
        delta, status = np.empty_like(rows.b), np.empty(len(desired), dtype=np.int64)
        fallbacks = np.zeros(len(desired), dtype=np.int64)
        filter_batch(
            self._kind, self._vertices, program.input_set.radius, desired, rows.a, rows.b,
            rows.priority.astype(np.int64, copy=False), program.least_slack(rows),
            program.weight(rows), program.lambda_u,
            stages.make_workspace(len(self._vertices), rows.b.shape[1]), u, slack, delta, status,
        )  # fmt: skip
        result = FilterResult(u, slack, delta, status, fallbacks)
        for i in np.flatnonzero(status == GRADED_STATUS):
            row = CbfRows(*(field[i] for field in rows if field is not None))
            alone = program.of_state(int(i))(desired[i], row)
            for many, one in zip(result, alone, strict=True):
                many[i] = one
        return result


@njit(cache=True)
def filter_batch(
    kind: int,
    vertices: Array,
    radius: float,
    u_nominal: Array,
    a: Array,
    b: Array,
    priority: Integers,
    least: Array,
    weight: Array,
    lambda_u: float,
    w: Workspace,
    u: Array,
    slack: Array,
    delta: Array,
    status: Integers,
) -> None:
    """Filter N inputs and account for them, writing to `u`, `slack`, `delta` and `status`.

    Args:
        kind: which program.
        vertices: (V, 2) the corners of U, counter-clockwise.
        radius: the largest norm of an input.
        u_nominal: (N, 2) u*.
        a: (N, m, 2) gradients.
        b: (N, m) bounds.
        priority: (N, m) from 1 without a gap.
        least: (N, m) δ_min.
        weight: (N, m) λ_δk; infinity for a strict level of Lex-CBF-QP.
        lambda_u: λ_u.
        w: working space for m rows.
        u: (N, 2) the filtered inputs.
        slack: (N, m) the violations.
        delta: (N, m) the programs' own relaxations.
        status: (N,) each a `FilterStatus`, or `GRADED_STATUS`.
    """
    m = b.shape[1]
    order, start = np.empty(m, dtype=np.int64), np.empty(m + 2, dtype=np.int64)
    row_a, row_b = np.empty((m, 2)), np.empty(m)
    row_least, row_weight = np.empty(m), np.empty(m)
    for i in range(u_nominal.shape[0]):
        ux, uy = u_nominal[i]
        if _allowed(vertices, a[i], b[i], ux, uy):
            u[i, 0], u[i, 1] = ux, uy
            slack[i], delta[i], status[i] = 0.0, least[i], 0  # NOMINAL
            continue
        levels = _sort(priority[i], order, start)
        for k in range(m):
            row_a[k], row_b[k] = a[i, order[k]], b[i, order[k]]
            row_least[k], row_weight[k] = least[i, order[k]], weight[i, order[k]]
        w.graded[0] = False
        x, y = _decide(
            kind, vertices, row_a, row_b, row_least, row_weight, start, levels, lambda_u, ux, uy,
            radius, w,
        )  # fmt: skip
        if w.graded[0]:
            status[i] = GRADED_STATUS
            continue
        u[i, 0], u[i, 1] = x, y
        moved = max(abs(x - ux), abs(y - uy)) > NOMINAL_TOLERANCE * (1.0 + radius)
        status[i] = 1 if moved else 0
        for k in range(m):
            row = order[k]
            value = row_a[k, 0] * x + row_a[k, 1] * y
            lack = row_b[k] - value
            scale = np.hypot(row_a[k, 0], row_a[k, 1]) * radius + abs(row_b[k])
            slack[i, row] = lack if lack > SLACK_TOLERANCE * scale else 0.0
            delta[i, row] = slack[i, row]
            if k >= start[1] and kind == _RELAXED:
                delta[i, row] = max(slack[i, row], row_least[k])
            elif k >= start[1] and kind in (_HIERARCHICAL, _EXPLICIT):
                delta[i, row] = w.target[k] - value
            if slack[i, row] > 0.0:
                strict = k < start[1] or kind == _CBF
                status[i] = max(status[i], 3 if strict else 2)


@njit(cache=True)
def _allowed(vertices: Array, a: Array, b: Array, ux: float, uy: float) -> bool:
    """Tell whether u* lies in U and meets every row."""
    for k in range(b.size):
        if a[k, 0] * ux + a[k, 1] * uy < b[k]:
            return False
    previous_x, previous_y = vertices[-1]
    for i in range(vertices.shape[0]):
        x, y = vertices[i]
        if (x - previous_x) * (uy - previous_y) < (y - previous_y) * (ux - previous_x):
            return False
        previous_x, previous_y = x, y
    return True


@njit(cache=True)
def _sort(priority: Integers, order: Integers, start: Integers) -> int:
    """Sort rows by priority into `order`; the rows of level p start at ``start[p - 1]``.

    Returns:
        The number of levels.
    """
    m = priority.size
    start[:] = 0
    levels = 0
    for k in range(m):
        start[priority[k]] += 1
        levels = max(levels, priority[k])
    total = 0
    for level in range(levels + 1):  # start[p] becomes where level p's rows are to go next
        count = start[level]
        start[level] = total
        total += count
    for k in range(m):
        order[start[priority[k]]] = k
        start[priority[k]] += 1
    return levels


@njit(cache=True)
def _decide(
    kind: int,
    vertices: Array,
    a: Array,
    b: Array,
    least: Array,
    weight: Array,
    start: Integers,
    levels: int,
    lambda_u: float,
    ux: float,
    uy: float,
    radius: float,
    w: Workspace,
) -> stages.Point:
    """Run one program on rows sorted by priority."""
    count = vertices.shape[0]
    w.feasible[:count] = vertices
    strict = b.size if kind == _CBF else start[1]
    count = stages.meet(count, a[:strict], b[:strict], radius, w)
    if kind == _CBF:
        return stages.project(w.feasible, count, ux, uy, radius, w)
    if kind == _LEXICOGRAPHIC:
        return stages.lexicographic(count, a, b, weight, start, levels, lambda_u, ux, uy, radius, w)
    lower_a, lower_b, lower_weight = a[strict:], b[strict:], weight[strict:]
    if kind == _RELAXED:
        return stages.relax(
            count, lower_a, lower_b, least[strict:], lower_weight, lambda_u, ux, uy, radius, w
        )
    stages.set_targets(vertices, a, b, ux, uy, radius, w)
    if kind == _HIERARCHICAL:
        return stages.draw(
            count, lower_a, w.target[strict:], lower_weight, lambda_u, ux, uy, radius, w
        )
    return stages.explicit(count, a, weight, start, levels, lambda_u, ux, uy, radius, w)
