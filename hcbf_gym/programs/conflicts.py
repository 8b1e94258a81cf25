"""Finds which rows of a state conflict, and how far a relaxed row's set has grown."""

from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import InvalidInputError, finite_float, instance
from hcbf_gym.models import input_sets
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.program import check_rows
from hcbf_gym.programs.result import FilterResult


class ConflictReport(NamedTuple):
    """A conflict: rows that no input meets together.

    Attributes:
        rows: indices of an irreducible infeasible subset: without any one of them, the others can
            be met in U. Rows of higher priority are preferred.
        needs_input_set: whether U's limits are part of the conflict, that is, whether an unbounded
            input could meet these rows.
        paid: priority → the largest violation among its rows, for each violated priority.
    """

    rows: tuple[int, ...]
    needs_input_set: bool
    paid: dict[int, float]


def conflict_report(
    rows: CbfRows, result: FilterResult, input_set: InputSet
) -> ConflictReport | None:
    """Return the conflict among the rows of one state; None if an input meets all of them.

    The subset is found by a deletion filter: rows are left out one by one, the lowest priority
    first, as long as the rest stays infeasible.

    Args:
        rows: the rows of one state.
        result: the result of a program for these rows.
        input_set: U, or a bounded action space of Gymnasium.

    Raises:
        InvalidInputError: if rows are malformed, the result is of others, or U is not one.
    """
    input_set = input_sets.read("input_set", input_set)
    check_rows(rows, input_set.n_u)
    instance("result", result, FilterResult)
    if np.shape(result.slack) != rows.b.shape or rows.b.ndim != 1:
        raise InvalidInputError(
            f"conflict report: got rows of shape {rows.b.shape} and a result of shape "
            f"{np.shape(result.slack)}, expected both of one state: (m,)"
        )
    return conflict_among(rows, result.slack, input_set.halfspaces())


def conflict_among(
    rows: CbfRows, slack: Array, admissible: tuple[Array, Array]
) -> ConflictReport | None:
    """Return the conflict among well-formed rows; see `conflict_report`.

    Args:
        rows: the rows of one state.
        slack: (m,) the violation of each row by a program's input.
        admissible: A (V, n_u) and b (V,) of ``U = {u : A u ≥ b}``.
    """
    subset = np.argsort(rows.priority, kind="stable")
    if _is_feasible(rows, subset, admissible):
        return None
    for row in subset[::-1]:
        rest = subset[subset != row]
        if not _is_feasible(rows, rest, admissible):
            subset = rest
    unbounded = (admissible[0][:0], admissible[1][:0])
    paid = {
        int(priority): float(slack[rows.priority == priority].max())
        for priority in np.unique(rows.priority[slack > 0.0])
    }
    indices = tuple(sorted(int(row) for row in subset))
    return ConflictReport(indices, _is_feasible(rows, subset, unbounded), paid)


def _is_feasible(rows: CbfRows, subset: Integers, halfspaces: tuple[Array, Array]) -> bool:
    """Return whether an input within the halfspaces A u ≥ b meets all rows of a subset."""
    a, b = rows.a[subset], rows.b[subset]
    is_constant = np.einsum("ij,ij->i", a, a) <= _core.ZERO_GRADIENT**2
    if (b[is_constant] > 0.0).any():  # no input changes such a row
        return False
    a, b = np.concatenate((halfspaces[0], a)), np.concatenate((halfspaces[1], b))
    return _core.nearest_point(a, b, np.zeros(a.shape[1])) is not None


def equivalent_offset(alpha2: ClassK, psi: float, delta: float) -> float:
    r"""Return the offset c by which a relaxation δ enlarges a row's set.

    .. math:: c = α₂^{-1}(α₂(ψ) + δ) − ψ

    With the offset the row reads as the CBF condition of ``ψ + c``, whose safe set is
    ``{x : ψ(x) ≥ −c}``.

    Args:
        alpha2: α₂.
        psi: the barrier at its relative degree.
        delta: δ.

    Raises:
        InvalidInputError: if α₂ is no class-K function, or a number is not finite.

    Source: section III-A of the paper.
    """
    alpha2 = instance("alpha2", alpha2, ClassK)
    psi, delta = finite_float("psi", psi), finite_float("delta", delta)
    return alpha2.inverse(alpha2(psi) + delta) - psi
