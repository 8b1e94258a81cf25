r"""The programs, each beside its equation, and what each does with the stages.

Throughout, u ∈ U, rows of one priority are one stage, and û_k solves the program of row k alone: it
is the input of U nearest u* that meets row k or, where none does, violates it least.

A cascade is written in terms of :class:`Inputs`, the inputs that its stages so far leave. Rational
numbers (`exact`) and QP solvers (`general`) each bring theirs. `planar.cascade` is the compiled
form of the same text for two inputs; the tests hold them together.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.errors import InvalidInputError, choose, finite_float
from hcbf_gym.programs.weights import Weights

Array = NDArray[Any]


class StageRows(NamedTuple):
    """Rows as the stages read them; doubles, or rational numbers in arrays of objects.

    Attributes:
        a: (s, n_u) gradients.
        b: (s,) bounds.
        priority: (s,) from 1.
        strict: (s,) whether a stage meets the row, instead of paying for it.
        weight: (s,) λ_δ(h); 1 for a strict row.
        least: (s,) δ_min.
    """

    a: Array
    b: Array
    priority: NDArray[np.int64]
    strict: NDArray[np.bool_]
    weight: Array
    least: Array

    def only(self, chosen: Array) -> "StageRows":
        """Return the chosen (s,) rows."""
        a, b, priority, strict, weight, least = self
        return StageRows(
            a[chosen], b[chosen], priority[chosen], strict[chosen], weight[chosen], least[chosen]
        )


class Inputs(Protocol):
    """The inputs that the stages so far leave: never none. It knows u*."""

    def nearest(self) -> Array:
        """Return ``argmin ‖u − u*‖²``."""
        ...

    def meeting(self, rows: StageRows) -> Self | None:
        """Keep those that meet the rows; None where none does."""
        ...

    def violating_least(self, rows: StageRows) -> Self:
        """Keep those that violate the rows least, ``min Σ max(0, b_k − a_k u)²``."""
        ...

    def meet(self, rows: StageRows) -> Self:
        """Keep those that meet the rows or, where none does, violate them least."""
        met = self.meeting(rows)
        return self.violating_least(rows) if met is None else met

    def relax(self, rows: StageRows, lambda_u: float) -> Array:
        """Return ``argmin λ_u ‖u − u*‖² + Σ λ_δk max(δ_min, b_k − a_k u)²``."""
        ...

    def draw(self, rows: StageRows, target: Array, lambda_u: float) -> Array:
        """Return ``argmin λ_u ‖u − u*‖² + Σ λ_δk (t_k − a_k u)²``."""
        ...

    def pin(self, rows: StageRows, u: Array) -> Self:
        """Keep those at which each row has the value that it has at u, one of them."""
        ...

    def bound(self, rows: StageRows, u: Array) -> Self:
        """Keep those at which no row is violated more than at u, one of them."""
        ...


AnyInputs = TypeVar("AnyInputs", bound=Inputs)


class Cascade(ABC):
    """A program without its input set: its options, and what it does stage by stage."""

    options: ClassVar[tuple[str, ...]] = ()
    weights: Weights = Weights()
    lambda_u: float = 1.0

    @abstractmethod
    def decide(self, inputs: Inputs, rows: StageRows) -> tuple[Array, Array | None]:
        """Return u, and the targets ``a_k û_k`` (m,) of a program that has such.

        Args:
            inputs: U.
            rows: all rows.
        """

    def least_slack(self, rows: CbfRows) -> Array:
        """Return δ_min (m,), the least relaxation that the program allows."""
        return np.zeros(rows.b.shape)

    def stage_rows(self, rows: CbfRows, state: int = 0) -> StageRows:
        """Return the rows as the stages read them; `state` counts where weights are a state's."""
        strict, weight = np.ones(rows.b.size, dtype=np.bool_), np.ones(rows.b.size)
        if self._has_weights:
            weight = self.weights.of(rows.priority, rows.h, state)
            strict = (rows.priority == 1) | np.isinf(weight)
            weight = np.where(strict, 1.0, weight)
        return StageRows(rows.a, rows.b, rows.priority, strict, weight, self.least_slack(rows))

    @cached_property
    def _has_weights(self) -> bool:
        return bool(np.isfinite(self.weights.table[:, 1:]).any())

    def delta(self, rows: CbfRows, u: Array, slack: Array, target: Array | None) -> Array:
        """Return the program's own relaxation δ (m,): the slack unless it says otherwise."""
        return slack.copy()


class CbfQp(Cascade):
    r"""CBF-QP (section II-C): every row is hard.

    .. math:: \min_{u ∈ U} ‖u^⋆ − u‖² \quad \text{s.t.}\quad a_k u ≥ b_k \;\text{for all } k.

    Where the rows conflict it has no solution and says so: the status is VIOLATED whatever the
    priority of the row that is missed, and u violates the rows least, ``min Σ δ_k²``.
    """

    def decide(self, inputs: Inputs, rows: StageRows) -> tuple[Array, None]:
        """One stage."""
        return inputs.meet(rows).nearest(), None


class _Weighted(Cascade):
    """A program that trades the rows of lower priority against ``λ_u ‖u − u*‖²``.

    Args:
        gamma0: γ₀ ≥ 0, or one for each priority from 2 on, the last one repeated; (N, levels) for
            a batch whose N states have weights of their own.
        delta_gamma: Δγ ≥ 0; (N, 1) likewise.
        lambda_u: λ_u ≥ 0. λ_u = 0 and λ_δ = 0 are limits: the first breaks ties towards u*, the
            second lets the row go.

    Raises:
        InvalidInputError: on weights that are negative or not finite.
    """

    options = ("gamma0", "delta_gamma", "lambda_u")

    def __init__(
        self,
        *,
        gamma0: float | Sequence[float] | Array = 5.0,
        delta_gamma: float | Array = 1.3,
        lambda_u: float = 1.0,
    ) -> None:
        self.weights = Weights.read(gamma0, delta_gamma)
        self.lambda_u = finite_float("lambda_u", lambda_u, minimum=0.0)


class RelaxedCbfQp(_Weighted):
    r"""R-CBF-QP (section III-A) with m rows: lower rows may be missed, at a price.

    .. math::
        \min_{u ∈ U,\, δ ≥ δ_{min}} λ_u ‖u^⋆ − u‖² + \sum_k λ_{δ_k} δ_k² \quad \text{s.t.}\quad
        a_i u ≥ b_i \;(\text{priority } 1), \qquad a_k u ≥ b_k − δ_k \;(\text{others}).

    Args:
        epsilon: "zero" gives δ_min = 0; "known" takes the least offset ε = max(0, −ψ) that puts
            the state into the enlarged set: δ_min = α₂(ψ + ε) − α₂(ψ).
        weights: γ₀, Δγ and λ_u.

    Raises:
        InvalidInputError: on other values.
    """

    options = (*_Weighted.options, "epsilon")

    def __init__(self, *, epsilon: Literal["zero", "known"] = "zero", **weights: Any) -> None:
        super().__init__(**weights)
        self.epsilon = choose("epsilon", epsilon, {"zero": "zero", "known": "known"})

    def decide(self, inputs: Inputs, rows: StageRows) -> tuple[Array, None]:
        """Meet priority 1, relax the others."""
        lower = rows.only(rows.priority > 1)
        return inputs.meet(rows.only(rows.priority == 1)).relax(lower, self.lambda_u), None

    def least_slack(self, rows: CbfRows) -> Array:
        """Return δ_min (m,).

        Since ψ + ε is 0 where ψ < 0 and ψ elsewhere, ``α₂(ψ + ε) − α₂(ψ) = max(0, −α₂(ψ))``.

        Raises:
            InvalidInputError: if ε is to be known and the rows do not carry α₂(ψ).
        """
        if self.epsilon == "zero":
            return np.zeros(rows.b.shape)
        if rows.alpha2_psi is None:
            raise InvalidInputError(
                "rows.alpha2_psi: got None, expected α₂(ψ) of each row for epsilon='known'"
            )
        return np.where(rows.priority == 1, 0.0, np.maximum(0.0, -rows.alpha2_psi))

    def delta(self, rows: CbfRows, u: Array, slack: Array, target: Array | None) -> Array:
        """Return ``max(δ_min, slack)`` (m,)."""
        return np.maximum(slack, self.least_slack(rows))


class HierarchicalCbfQp(_Weighted):
    r"""H-CBF-QP for one relaxed row, IH-CBF-QP for several (sections III-B, III-C).

    Lower rows are drawn to what each would get alone:

    .. math::
        \min_{u ∈ U,\, δ} λ_u ‖u^⋆ − u‖² + \sum_k λ_{δ_k} δ_k² \quad \text{s.t.}\quad
        a_i u ≥ b_i \;(\text{priority } 1), \qquad a_k u + δ_k = a_k û_k \;(\text{others}).
    """

    def decide(self, inputs: Inputs, rows: StageRows) -> tuple[Array, Array]:
        """Meet priority 1, draw the others to their targets."""
        target, lower = self.targets(inputs, rows), rows.priority > 1
        feasible = inputs.meet(rows.only(~lower))
        return feasible.draw(rows.only(lower), target[lower], self.lambda_u), target

    def targets(self, inputs: Inputs, rows: StageRows) -> Array:
        """Return ``a_k û_k`` (m,) of the lower rows, and b_k of those of priority 1."""
        target, nominal = rows.b.copy(), inputs.nearest()
        for k in np.flatnonzero(rows.priority > 1):
            target[k] = rows.a[k] @ nominal
            if target[k] < rows.b[k]:
                target[k] = rows.a[k] @ inputs.meet(rows.only(np.array([k]))).nearest()
        return target

    def delta(self, rows: CbfRows, u: Array, slack: Array, target: Array | None) -> Array:
        """Return ``a_k·(û_k − u)`` (m,) of the lower rows, the slack of the others."""
        assert target is not None
        return np.where(rows.priority == 1, slack, target - rows.a @ u)


class ExplicitHierarchicalCbfQp(HierarchicalCbfQp):
    r"""EH-CBF-QP (section III-D) as printed: each level is pinned before the next.

    For each priority p = 2, 3, …

    .. math::
        \min_{u ∈ U,\, δ} λ_u ‖u^⋆ − u‖² + \sum_{k ∈ p} λ_{δ_k} δ_k² \quad \text{s.t.}\quad
        & a_i u ≥ b_i \;(\text{priority } 1), \\
        & a_i u + δ_i^⋆ = a_i û_i \;(\text{priorities } 2 … p−1), \\
        & a_k u + δ_k = a_k û_k \;(\text{priority } p).

    The equalities hold whether or not a row is near its bound: in the plane two of them leave
    nothing to decide.
    """

    def decide(self, inputs: Inputs, rows: StageRows) -> tuple[Array, Array]:
        """Meet priority 1; level by level, draw and pin."""
        target = self.targets(inputs, rows)
        feasible = inputs.meet(rows.only(rows.priority == 1))
        u = feasible.nearest()
        for priority in range(2, rows.priority.max(initial=1) + 1):
            level = rows.priority == priority
            u = feasible.draw(rows.only(level), target[level], self.lambda_u)
            feasible = feasible.pin(rows.only(level), u)
        return u, target


class LexicographicCbfQp(Cascade):
    r"""Lex-CBF-QP (ours): no row gives way while one of lower priority still could.

    For each priority p = 1, 2, …, with :math:`δ_i^⋆` the violations of the earlier stages,

    .. math::
        \min_{u ∈ U,\, δ ≥ 0} \sum_{k ∈ p} δ_k² \quad \text{s.t.}\quad
        a_i u ≥ b_i − δ_i^⋆ \;(\text{priorities } 1 … p−1), \qquad a_k u ≥ b_k − δ_k,

    and at last the u nearest u*. A level with a finite weight minimises
    :math:`λ_u ‖u^⋆ − u‖² + \sum_{k ∈ p} λ_{δ_k} δ_k²` instead, and its δ is locked in the same way.

    Args:
        weights: γ₀ of each priority from 1 on; None is a strict level, and so is a priority
            beyond the end. Priority 1 is always strict.
        delta_gamma: Δγ of the levels with a weight, ``λ_δ = γ₀ (1 + Δγ max(0, −h))``.
        lambda_u: λ_u of the levels with a weight.

    Raises:
        InvalidInputError: on weights that are negative or not finite, or one for priority 1.
    """

    options = ("weights", "delta_gamma", "lambda_u")

    def __init__(
        self,
        *,
        weights: Sequence[float | None] = (),
        delta_gamma: float = 0.0,
        lambda_u: float = 1.0,
    ) -> None:
        if isinstance(weights, str) or not isinstance(weights, Sequence):
            raise InvalidInputError(f"weights: got {weights!r}, expected a list of numbers or None")
        if weights and weights[0] is not None:
            raise InvalidInputError(f"weights: got {weights[0]} for priority 1, expected None")
        self.weights = Weights.of_levels(weights[1:], delta_gamma)
        self.lambda_u = finite_float("lambda_u", lambda_u, minimum=0.0)

    def decide(self, inputs: Inputs, rows: StageRows) -> tuple[Array, None]:
        """Level by level, meet or relax, and lock."""
        done = 0
        if rows.strict.all():
            inputs, done = _meet_most(inputs, rows)
        for priority in range(done + 1, rows.priority.max(initial=0) + 1):
            level = rows.only(rows.priority == priority)
            if level.strict.all():
                inputs = inputs.meet(level)
            else:
                inputs = inputs.bound(level, inputs.relax(level, self.lambda_u))
        return inputs.nearest(), None


def _meet_most(inputs: AnyInputs, rows: StageRows) -> tuple[AnyInputs, int]:
    """Meet as many levels as can be met together, and the next one as well as it can be.

    It keeps what a stage for each of them would, in fewer steps: without conflict in one.

    Returns:
        The inputs that are left, and the last of those levels.
    """
    lowest = int(rows.priority.max(initial=0))
    for last in range(lowest, 0, -1):
        met = inputs.meeting(rows if last == lowest else rows.only(rows.priority <= last))
        if met is not None:
            break
    else:
        met, last = inputs, 0
    if last == lowest:
        return met, last
    return met.violating_least(rows.only(rows.priority == last + 1)), last + 1


CASCADES: dict[str, type[Cascade]] = {
    "cbf-qp": CbfQp,
    "r-cbf-qp": RelaxedCbfQp,
    "h-cbf-qp": HierarchicalCbfQp,
    "ih-cbf-qp": HierarchicalCbfQp,
    "eh-cbf-qp": ExplicitHierarchicalCbfQp,
    "lex-cbf-qp": LexicographicCbfQp,
}
