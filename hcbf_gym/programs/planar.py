"""The programs of two inputs: N states in one call of the core; one state is the case N = 1.

No solver is called: the inputs that the stages leave are polygons, cut and searched in doubles.
What is given up with that: the violations that a level pays are the least up to rounding, and u is
as exact as they decide it; see `soft_minimum::keep_least`.
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
    """What one state and N of them share: a program as the core reads it."""

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

        Corners (1, V, 2) of U and weights (K, 1 + L) are last; K is 1, or N.

        Raises:
            InvalidInputError: if the weights are those of another number of states.
        """
        self.prices.check(count)
        return self._settings.copy()

    def _solve(self, u_nominal: Array, rows: CbfRows) -> Array:
        """Return u, slack, δ and the statuses of all states, one after the other."""
        if rows.alpha2_psi is None:
            rows = self.prices.complete(rows)
        shape = rows.b.shape
        kind, psi = rows.priority.dtype.kind, rows.alpha2_psi
        fits = rows.a.shape == (*shape, 2) and rows.h.shape == rows.priority.shape == shape
        fits = fits and type(psi) is np.ndarray and psi.shape == shape and holds_numbers(psi.dtype)
        if not fits or kind not in "iu":
            check_shapes(rows, 2)
        answer = np.empty(3 * (u_nominal.size // 2) + 2 * rows.b.size)
        if not self._core.filter(
            u_nominal,
            np.ascontiguousarray(rows.a, np.float64),
            np.ascontiguousarray(rows.b, np.float64),
            np.ascontiguousarray(rows.h, np.float64),
            np.ascontiguousarray(rows.priority, np.int64),
            np.ascontiguousarray(psi, np.float64),
            answer,
        ):
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
    """The same filter as a single program of two inputs, for N states at once."""

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
        desired = finite_array("u_nominal", floats("u_nominal", u_nominal), (None, 2))
        count, dimensions = len(desired), _dimensions(rows)
        shape = rows.b.shape
        if dimensions != 2 or shape[0] != count:
            raise InvalidInputError(f"rows.b: got shape {shape}, expected ({count}, m)")
        self.prices.check(count)
        answer = self._solve(desired, rows)
        sizes = 2 * count, rows.b.size, rows.b.size
        u, slack, delta, status = np.split(answer, np.cumsum(sizes))
        return FilterResult(
            u.reshape(count, 2),
            slack.reshape(shape),
            delta.reshape(shape),
            status.astype(np.int64),
            np.zeros(count, dtype=np.int64),
        )


def _dimensions(rows: CbfRows) -> int:
    """Return how many axes b has."""
    parts = rows if isinstance(rows, CbfRows) else (None,)
    if not all(type(part) is np.ndarray and holds_numbers(part.dtype) for part in parts[:4]):
        check_shapes(rows, 2)
    return rows.b.ndim
