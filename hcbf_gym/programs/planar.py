"""The programs of two inputs: N states in one call of the core; one state is the case N = 1.

No solver is called, because the inputs that the stages leave are polygons, which are cut and
searched in doubles. The price is that the violations of a level are the least up to rounding, and
that u is as exact as they decide it; see `soft_minimum::keep_least`.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import InvalidInputError, finite_array, floats, holds_numbers
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.programs.plans import LOCK, LOWER, Plan
from hcbf_gym.programs.prices import Prices
from hcbf_gym.programs.program import Program, check_shapes, explain
from hcbf_gym.programs.result import FilterResult, FilterStatus

_STATUSES = tuple(FilterStatus)


class _Compiled:
    """A compiled program of two inputs, for one state or for N."""

    def __init__(self, plan: Plan, prices: Prices, input_set: InputSet) -> None:
        if input_set.n_u != 2:
            raise InvalidInputError(
                f"batch: got {input_set.n_u} inputs, expected 2: use the single program"
            )
        self.plan, self.prices, self.input_set = plan, prices, input_set
        self._settings: dict[str, Any] = {
            "lower": LOWER.index(plan.lower),
            "by_level": plan.order == "by level",
            "lock": LOCK.index(plan.lock),
            "ranks": plan.ranks,
            "guided": plan.strict == "all" and plan.order == "by level",
            "radius": input_set.radius,
            "lambda_u": prices.lambda_u,
            "known_offset": prices.known_offset,
            "vertices": np.ascontiguousarray(input_set.vertices())[None],
            "weights": np.ascontiguousarray(prices.weights),
        }
        self._core = _core.PlanarProgram(*self._settings.values())

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.plan, self.prices, self.input_set)

    def settings_of(self, count: int) -> dict[str, Any]:
        """Return the fields of the core's `program_records::Settings` for a filter of N states.

        The last two are `vertices` (1, V, 2) of U and `weights` (K, 1 + L); K is 1, or N.
        """
        self.prices.check(count)
        return self._settings.copy()

    def _solve(self, u_nominal: Array, rows: CbfRows) -> Array:
        """Return u of all states, then all slacks, all δ and all statuses, as one array."""
        if rows.alpha2_psi is None:
            rows = self.prices.complete(rows)
        shape, psi = rows.b.shape, rows.alpha2_psi
        is_checked = (
            rows.a.shape == (*shape, 2)
            and rows.h.shape == rows.priority.shape == shape
            and rows.priority.dtype.kind in "iu"
            and type(psi) is np.ndarray
            and psi.shape == shape
            and holds_numbers(psi.dtype)
        )
        if not is_checked:
            check_shapes(rows, 2)  # raises with a message
        answer = np.empty(3 * (u_nominal.size // 2) + 2 * rows.b.size)
        is_well_formed = self._core.filter(
            u_nominal,
            np.ascontiguousarray(rows.a, np.float64),
            np.ascontiguousarray(rows.b, np.float64),
            np.ascontiguousarray(rows.h, np.float64),
            np.ascontiguousarray(rows.priority, np.int64),
            np.ascontiguousarray(psi, np.float64),
            answer,
        )
        if not is_well_formed:
            finite_array("u_nominal", u_nominal, u_nominal.shape)
            explain(rows)
        return answer


class PlanarProgram(_Compiled, Program):
    """A program of two inputs for a single state."""

    def __init__(self, plan: Plan, prices: Prices, input_set: InputSet) -> None:
        super().__init__(plan, prices, input_set)
        prices.check(1)

    def __call__(self, u_nominal: ArrayLike, rows: CbfRows) -> FilterResult:
        """Filter one nominal input; see :class:`Program`."""
        u = u_nominal
        if not (type(u) is np.ndarray and u.shape == (2,) and u.dtype == np.float64):
            u = finite_array("u_nominal", floats("u_nominal", u, (2,)), (2,))
        if _dimensions(rows) != 1:
            raise InvalidInputError(f"rows.b: got shape {rows.b.shape}, expected (m,): one state")
        answer = self._solve(np.ascontiguousarray(u), rows)
        end, status = 2 + rows.b.size, _STATUSES[int(answer[-1])]
        return FilterResult(answer[:2], answer[2:end], answer[end:-1], status, 0)


class BatchProgram(_Compiled):
    """A program of two inputs for N states at once; each result is that of the single program."""

    def __call__(self, u_nominal: ArrayLike, rows: CbfRows) -> FilterResult:
        """Filter N nominal inputs.

        Args:
            u_nominal: (N, 2) u*, inside U or not.
            rows: the rows of N states, each array with a leading N; m is the same for all.

        Returns:
            The result with a leading N; `status` and `fallbacks` are (N,) integers.

        Raises:
            InvalidInputError: on malformed input or rows, or weights of another number of states.
        """
        u_nominal = finite_array("u_nominal", floats("u_nominal", u_nominal), (None, 2))
        count, dimensions = len(u_nominal), _dimensions(rows)
        shape = rows.b.shape
        if dimensions != 2 or shape[0] != count:
            raise InvalidInputError(f"rows.b: got shape {shape}, expected ({count}, m)")
        self.prices.check(count)
        answer = self._solve(u_nominal, rows)
        u_slack_and_delta = 2 * count, rows.b.size, rows.b.size
        u, slack, delta, status = np.split(answer, np.cumsum(u_slack_and_delta))
        return FilterResult(
            u.reshape(count, 2),
            slack.reshape(shape),
            delta.reshape(shape),
            status.astype(np.int64),
            np.zeros(count, dtype=np.int64),
        )


def _dimensions(rows: CbfRows) -> int:
    """Return the number of axes of b; refuse rows that are not arrays of numbers."""
    arrays = rows[:4] if isinstance(rows, CbfRows) else (None,)
    if not all(type(array) is np.ndarray and holds_numbers(array.dtype) for array in arrays):
        check_shapes(rows, 2)  # raises with a message
    return rows.b.ndim
