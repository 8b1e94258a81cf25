"""What every program shares: its door, its weights, and the account of what each row pays."""

import copy
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import (
    InvalidInputError,
    SolverError,
    finite_array,
    finite_float,
)
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.general.dense import well_formed
from hcbf_gym.programs.general.qp import Solver, check_solver
from hcbf_gym.programs.general.stage import FeasibleSet
from hcbf_gym.programs.result import FilterResult, FilterStatus, classify, violation

Array = NDArray[np.float64]


def check_rows(rows: CbfRows, n_u: int) -> None:
    """Refuse rows that no program can read.

    Args:
        rows: the rows of one state; of N states with a leading axis.
        n_u: the number of inputs.

    Raises:
        InvalidInputError: on shapes that do not match, entries that are not finite, or priorities
            that are not the integers from 1 without a gap.
    """
    shape = rows.b.shape
    expected = {"a": (*shape, n_u), "h": shape, "priority": shape}
    if rows.alpha2_psi is not None:
        expected["alpha2_psi"] = shape
    for name, wanted in expected.items():
        got = getattr(rows, name).shape
        if got != wanted:
            raise InvalidInputError(f"rows.{name}: got shape {got}, expected {wanted}")
    if rows.alpha2_psi is not None and not np.isfinite(rows.alpha2_psi).all():
        raise InvalidInputError(f"rows.alpha2_psi: got {rows.alpha2_psi}, expected finite numbers")
    if rows.priority.dtype.kind not in "iu":
        raise InvalidInputError(
            f"rows.priority: got {rows.priority.dtype}, expected integers from 1"
        )
    a, b, h, priority = rows.a, rows.b, rows.h, rows.priority
    if b.ndim == 1:
        a, b, h, priority = a[None], b[None], h[None], priority[None]
    if not well_formed(a, b, h, priority):
        _explain(rows)


def _explain(rows: CbfRows) -> NoReturn:
    """Raise the error that says what is wrong with the rows."""
    for name in ("a", "b", "h"):
        value = getattr(rows, name)
        if not np.isfinite(value).all():
            raise InvalidInputError(f"rows.{name}: got {value}, expected finite numbers")
    raise InvalidInputError(
        f"rows.priority: got {rows.priority.tolist()}, expected the integers from 1 without a gap"
    )


def check_weights(name: str, value: float | list[float] | Array) -> Array:
    """Return weights as an array, one entry for each relaxed priority, the last one repeated.

    An array (N, levels) holds those of N states; it is for batches alone.

    Raises:
        InvalidInputError: on an empty list, or entries that are negative or not finite.
    """
    if isinstance(value, np.ndarray) and value.ndim == 2 and value.size:
        weights = finite_array(name, value, (None, None))
        if (weights < 0.0).any():
            raise InvalidInputError(f"{name}: got {weights.min()}, expected numbers >= 0.0")
        return weights
    entries = list(value) if isinstance(value, Sequence) else [value]
    if not entries:
        raise InvalidInputError(f"{name}: got an empty list, expected at least one weight")
    return np.array([finite_float(name, entry, minimum=0.0) for entry in entries])


class Program(ABC):
    """A safety filter ``(u*, rows) → FilterResult`` for one input set and one solver.

    Args:
        input_set: U.
        solver: the solver's name; Clarabel answers where it fails (DAQP where that is Clarabel).

    Raises:
        UnknownNameError: if no such solver is installed.
    """

    options: ClassVar[tuple[str, ...]] = ()
    lambda_u: float = 1.0

    def __init__(self, input_set: InputSet, solver: str) -> None:
        self.input_set = input_set
        self.solver = check_solver(solver)
        self._admissible = FeasibleSet.of_input_set(input_set)
        self._radius = input_set.radius

    @abstractmethod
    def decide(self, u_nominal: Array, rows: CbfRows, solver: Solver) -> tuple[Array, Array | None]:
        """Return u (n_u,) and δ (m,), or None where δ is the slack.

        Raises:
            SolverError: if a stage that has a solution was not solved.
        """

    def strict(self, rows: CbfRows) -> NDArray[np.bool_]:
        """Return which rows (m,) may not be relaxed: those of priority 1."""
        return rows.priority == 1

    def of_state(self, index: int) -> "Program":
        """Return the program of one state of a batch whose states have weights of their own."""
        return self

    def weight(self, rows: CbfRows) -> Array:
        """Return λ_δ (m,) of each row: infinity, unless the program lets rows give way."""
        return np.full(rows.b.shape, np.inf)

    def least_slack(self, rows: CbfRows) -> Array:
        """Return the least δ (m,) that the program allows; 0 unless it says otherwise."""
        return np.zeros(rows.b.shape)

    def __call__(self, u_nominal: ArrayLike, rows: CbfRows) -> FilterResult:
        """Filter one nominal input.

        Args:
            u_nominal: (n_u,) u*, inside U or not.
            rows: the rows of one state, m ≥ 0.

        Returns:
            The filtered input and what it costs. Where every solver failed, the braking action 0
            with status BACKUP.

        Raises:
            InvalidInputError: on malformed input or rows.
        """
        desired = finite_array("u_nominal", u_nominal, (self.input_set.n_u,))
        check_rows(rows, desired.size)
        if self.input_set.contains(desired, 0.0) and (rows.a @ desired >= rows.b).all():
            slack = np.zeros(rows.b.size)
            return FilterResult(desired, slack, self.least_slack(rows), FilterStatus.NOMINAL, 0)
        solver = Solver(self.solver)
        failed = False
        try:
            u, delta = self.decide(desired, rows, solver)
        except SolverError:
            u, delta, failed = np.zeros_like(desired), None, True
        u = self.input_set.project(u)
        slack = violation(rows, u, self._radius)
        status = classify(u, desired, slack, self.strict(rows), self._radius)
        return FilterResult(
            u,
            slack,
            slack.copy() if delta is None else delta,
            FilterStatus.BACKUP if failed else status,
            solver.fallbacks,
        )


class WeightedProgram(Program):
    """A program that trades the rows of lower priority against ``λ_u ‖u − u*‖²``.

    ``λ_δ(h) = γ₀`` where h > 0, else ``γ₀ (1 + Δγ |h|)`` (paper, section III-C). λ_u = 0 and
    λ_δ = 0 are limits: the first breaks ties towards u*, the second lets the row go.

    Args:
        input_set: U.
        solver: the solver's name.
        gamma0: γ₀ ≥ 0, or one for each priority from 2 on, the last one repeated; (N, levels) for
            a batch whose N states have weights of their own.
        delta_gamma: Δγ ≥ 0; (N, 1) likewise.
        lambda_u: λ_u ≥ 0.

    Raises:
        InvalidInputError: on weights that are negative or not finite.
    """

    options = ("gamma0", "delta_gamma", "lambda_u")

    def __init__(
        self,
        input_set: InputSet,
        solver: str,
        *,
        gamma0: float | list[float] | Array = 5.0,
        delta_gamma: float | Array = 1.3,
        lambda_u: float = 1.0,
    ) -> None:
        super().__init__(input_set, solver)
        self.gamma0 = check_weights("gamma0", gamma0)
        self.delta_gamma = (
            check_weights("delta_gamma", delta_gamma)
            if isinstance(delta_gamma, np.ndarray)
            else finite_float("delta_gamma", delta_gamma, minimum=0.0)
        )
        self.lambda_u = finite_float("lambda_u", lambda_u, minimum=0.0)

    def of_state(self, index: int) -> "WeightedProgram":
        """Return the program of one state of a batch whose states have weights of their own."""
        one = copy.copy(self)
        if self.gamma0.ndim == 2:
            one.gamma0 = self.gamma0[index]
        if isinstance(self.delta_gamma, np.ndarray):
            one.delta_gamma = float(self.delta_gamma[index, 0])
        return one

    def weight(self, rows: CbfRows) -> Array:
        """Return λ_δ(h) (m,) of the rows of one state; those of priority 1 have no use for it."""
        level = np.minimum(np.maximum(rows.priority - 2, 0), self.gamma0.shape[-1] - 1)
        delta_gamma = self.delta_gamma
        if isinstance(delta_gamma, np.ndarray) and delta_gamma.shape != (len(level), 1):
            raise InvalidInputError(
                f"delta_gamma: got shape {delta_gamma.shape}, expected ({len(level)}, 1): one for "
                f"each state of a batch, got rows of shape {level.shape}"
            )
        if self.gamma0.ndim == 1:
            gamma0 = self.gamma0[level]
        elif len(self.gamma0) == len(level) and level.ndim == 2:
            gamma0 = np.take_along_axis(self.gamma0, level, axis=1)
        else:
            raise InvalidInputError(
                f"gamma0: got weights of {len(self.gamma0)} states, expected a batch of as many, "
                f"got rows of shape {level.shape}"
            )
        return gamma0 * (1.0 + self.delta_gamma * np.maximum(0.0, -rows.h))
