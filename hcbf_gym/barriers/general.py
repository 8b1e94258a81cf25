"""From barriers to rows for any model: h(x, t) ≥ 0 is preserved by a condition linear in u."""

import math
import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier, Jet
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_cache import FunctionCache, SeparateRows
from hcbf_gym.barriers.function_rows import FunctionRows
from hcbf_gym.barriers.mapped import Mapped
from hcbf_gym.barriers.relative_degree import VANISHED, Reach, reach_by_jets, samples
from hcbf_gym.barriers.row_kernels import late
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.barriers.speed_limit import SpeedLimit
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.reduced_order import ReducedOrderModel


class Prepared(NamedTuple):
    """Barriers, with what stays the same from state to state.

    Attributes:
        barriers: m of them.
        own: places of those that are functions.
        functions: what makes the rows of these; None if there are none.
        rest: place and barrier of the others.
        reaches: (m,) how inputs reach each of them.
        priority: (m,).
        least: (m,) what a row reserves by itself: a speed limit's margin.
        share: (m,) how much of a margin on the position a row reserves.
    """

    barriers: tuple[Barrier, ...]
    own: list[int]
    functions: FunctionRows | SeparateRows | None
    rest: list[tuple[int, Barrier]]
    reaches: list[Reach]
    priority: NDArray[np.int64]
    least: Array
    share: Array

    def margins(self, margin: float) -> Array:
        """Return (m,) what each row reserves between h and zero."""
        return self.least + margin * self.share


class GeneralRows:
    r"""Rows ``a·u ≥ b`` for any model and any mix of barriers.

    With r the relative degree, :math:`ψ_0 = h − \text{margin}`,
    :math:`ψ_k = \dot ψ_{k−1} + α_1(ψ_{k−1})` for k < r, and the row asks for
    :math:`\dot ψ_{r−1}(x, u) ≥ −α_2(ψ_{r−1})`:

    .. math::
        a = L_g ψ_{r−1}, \qquad b = −α_2(ψ_{r−1}) − L_f ψ_{r−1} − ∂ψ_{r−1}/∂t.

    Where r is 2 and ψ_1 below zero, the row asks at least for a stop at h = margin, if U can (see
    `row_kernels.late`).

    r is found by looking at sampled states, once for each class of barrier that reads the same
    states. It is the least order at which *any* input appears: inputs that would appear later
    are not in the row, so that the filter leaves them free; `late_inputs` finds them. Where a
    row's L_g ψ vanishes at a state, its a is set to 0: no input helps or harms there, and b > 0
    then counts as a violation.

    Args:
        model: ẋ = f(x) + g(x)u.
        alpha1: α₁, applied to every ψ but the last.
        alpha2: α₂, applied to the last ψ.
        most: the most that U gives of a·u, for a (n_u,); None where U is not known.

    Attributes:
        conditioning: (m,) of the latest rows, from 0 to 1: 0 where the input does not matter, small
            where L_g ψ nearly vanishes, less than 1 at a kink of a function.
        functions: what was compiled for functions.

    Source: section II-C of the paper, with the high-order form for L_g h = 0.
    """

    def __init__(
        self,
        model: ReducedOrderModel,
        alpha1: ClassK,
        alpha2: ClassK,
        most: Callable[[Array], float] | None = None,
    ) -> None:
        self.model, self.alpha1, self.alpha2, self._most = model, alpha1, alpha2, most
        self.functions = FunctionCache(model, alpha1, alpha2)
        self._reaches: dict[tuple[type[Barrier], bytes], Reach] = {}
        self._somewhere = samples(model)[0][0]
        self._latest: Prepared | None = None
        self.conditioning = np.ones(0)

    def __call__(
        self,
        barriers: Sequence[Barrier],
        x: Array,
        t: Any = 0.0,
        margin: ArrayLike = 0.0,
        margin_rate: ArrayLike = 0.0,
    ) -> CbfRows:
        """Return the rows of one state.

        Args:
            barriers: m safety conditions.
            x: (n,) state; (N, n) where all barriers are functions, and every field has N rows.
            t: time [s]; (N,) for N states.
            margin: what rows reserve between h and zero: (m,), or one number for the rows of
                priority 1 that read the position.
            margin_rate: (m,) or one number, d margin/dt.

        Raises:
            InvalidInputError: if no input reaches a barrier by the second derivative, the model has
                no velocity for a speed limit, or a jet is not made of finite numbers.
        """
        prepared = self.prepare(barriers)
        kept = np.asarray(margin, dtype=np.float64)
        kept = kept if kept.ndim else prepared.margins(float(kept))
        rates = np.asarray(margin_rate, dtype=np.float64) + np.zeros(kept.shape)
        if prepared.functions is not None and len(prepared.own) == len(prepared.barriers):
            rows, self.conditioning = prepared.functions(x, t, kept, rates)
            return self._recovering(prepared, rows, kept)
        rows, self.conditioning = self._from_jets(prepared, x, t, kept, rates)
        if prepared.functions is not None:
            own = prepared.own
            functions, self.conditioning[own] = prepared.functions(x, t, kept[own], rates[own])
            rows.a[own], rows.b[own], rows.h[own] = functions.a, functions.b, functions.h
            if rows.alpha2_psi is not None:
                rows.alpha2_psi[own] = functions.alpha2_psi
        return self._recovering(prepared, rows, kept)

    def _recovering(self, prepared: Prepared, rows: CbfRows, margin: Array) -> CbfRows:
        """Return rows that ask for a stop where ψ is below zero; those of other states as given."""
        degrees = np.array([reach.degree for reach in prepared.reaches])
        if self._most is None or rows.alpha2_psi is None or not (rows.alpha2_psi < 0.0).any():
            return rows
        b = rows.b.copy()
        for at in map(tuple, np.argwhere((rows.alpha2_psi < 0.0) & (degrees == 2))):
            alpha2_psi, kept = float(rows.alpha2_psi[at]), float(rows.h[at] - margin[at[-1]])
            rate = self.alpha2.inverse(alpha2_psi) - self.alpha1(kept)
            lost = float(b[at]) + alpha2_psi + self.alpha1.derivative(kept) * rate
            b[at] = max(float(b[at]), late(kept, rate, lost, self._most(rows.a[at])))
        return rows._replace(b=b)

    def prepare(self, barriers: Sequence[Barrier]) -> Prepared:
        """Return what is known of these barriers, looked up once while these are the same."""
        key = tuple(barriers)
        latest = () if self._latest is None else self._latest.barriers
        if (
            self._latest is None
            or len(latest) != len(key)
            or any(map(operator.is_not, latest, key))
        ):
            own = [k for k, barrier in enumerate(key) if isinstance(barrier, Function)]
            functions = self._functions([key[k] for k in own])
            rest = [(k, barrier) for k, barrier in enumerate(key) if k not in own]
            found = {} if functions is None else dict(zip(own, functions.reaches, strict=True))
            found |= {k: self._reach(barrier) for k, barrier in rest}
            reaches = [found[k] for k in range(len(key))]
            priority = np.array([barrier.priority for barrier in key], dtype=np.int64)
            zero, one = margins(key, 0.0), margins(key, 1.0)
            self._latest = Prepared(key, own, functions, rest, reaches, priority, zero, one - zero)
        return self._latest

    def _functions(self, barriers: Sequence[Barrier]) -> FunctionRows | SeparateRows | None:
        """Return what makes the rows of functions, if there are any."""
        found = [barrier for barrier in barriers if isinstance(barrier, Function)]
        return self.functions.rows(found) if found else None

    def _from_jets(
        self, prepared: Prepared, x: Array, t: float, margin: Array, margin_rate: Array
    ) -> tuple[CbfRows, Array]:
        """Return the rows and their conditioning; those of functions are left empty."""
        m = len(prepared.barriers)
        gradients, rates = np.zeros((m, self.model.n)), np.zeros(m)
        h, last = np.zeros(m), np.zeros(m)
        drift, inputs = self.model.f(x), self.model.g(x)
        kept, growing = margin.tolist(), margin_rate.tolist()
        for k, barrier in prepared.rest:
            jet = _checked(barrier, barrier.jet(x, t), x.size)
            h[k] = jet.h
            psi = jet.h - kept[k]
            gradient = jet.gradient
            rate = jet.rate - growing[k]
            if prepared.reaches[k].degree == 2:
                slope = self.alpha1.derivative(psi)
                h_dot = float(gradient @ drift) + rate
                rate = float(jet.gradient_rate @ drift) + jet.rate_rate + slope * rate
                gradient = (
                    jet.hessian @ drift
                    + self.model.f_jacobian(x).T @ gradient
                    + jet.gradient_rate
                    + slope * gradient
                )
                psi = h_dot + self.alpha1(psi)
            gradients[k], rates[k], last[k] = gradient, rate, psi
        alpha2_psi = self.alpha2.values(last)
        a, b, conditioning = _in_input(gradients, drift, inputs)
        return CbfRows(a, -alpha2_psi - b - rates, h, prepared.priority, alpha2_psi), conditioning

    def relative_degree(self, barrier: Barrier) -> int:
        """Return how often h must be differentiated until an input appears.

        Raises:
            InvalidInputError: if none has appeared in the second derivative, or the barrier is a
                speed limit and the model has no velocity.
        """
        functions = self._functions([barrier])
        reach = self._reach(barrier) if functions is None else functions.reaches[0]
        return reach.degree

    def _reach(self, barrier: Barrier) -> Reach:
        """Return how inputs reach a barrier that gives jets; see `relative_degree`."""
        if isinstance(barrier, SpeedLimit) and self.model.velocity_at != 2:
            raise InvalidInputError(
                f"{barrier.name}: got a speed limit for {self.model}, expected a model with its "
                "velocity in x[2:4]"
            )
        jet = _checked(barrier, barrier.jet(self._somewhere, 0.0), self.model.n, finite=False)
        key = type(barrier), (jet.gradient != 0.0).tobytes()
        if key not in self._reaches:
            self._reaches[key] = reach_by_jets(barrier, self.model)
        return self._reaches[key]


def check_barriers(barriers: Any) -> tuple[Barrier, ...]:
    """Return barriers as a tuple.

    Raises:
        InvalidInputError: if they are no sequence of barriers.
    """
    listed = isinstance(barriers, Sequence) and not isinstance(barriers, str)
    if not listed or not all(isinstance(b, Barrier) for b in barriers):
        raise InvalidInputError(
            f"barriers: got {barriers!r}, expected a sequence of objects of classes derived from "
            "hcbf_gym.barriers.Barrier"
        )
    mapped = [barrier.name for barrier in barriers if isinstance(barrier, Mapped)]
    if mapped:
        raise InvalidInputError(
            f"barriers: got the classes {mapped} of a map, expected them for a plant of the planar "
            "double integrator: only its rows look beyond the nearest piece"
        )
    return tuple(barriers)


def _checked(barrier: Barrier, jet: Any, n: int, finite: bool = True) -> Jet:
    """Return what a barrier says of h and its derivatives.

    Args:
        barrier: which said it.
        jet: what it said.
        n: the number of states.
        finite: whether every number must be finite.

    Raises:
        InvalidInputError: if it is no jet of a function of n states, or not finite.
    """
    if isinstance(jet, Jet) and _is_plain(jet, n):
        return jet
    shapes = (), (n,), (n, n), (), (n,), ()
    try:
        fields = [np.asarray(field) for field in jet]
        fits = len(fields) == len(shapes) and all(
            field.shape == shape and field.dtype.kind in "fiu"
            for field, shape in zip(fields, shapes, strict=False)
        )
    except (TypeError, ValueError):  # nothing to go through, or a ragged list
        fields = []
        fits = False
    if not fits:
        raise InvalidInputError(
            f"{barrier.name}: got the jet {jet!r}, expected a barriers.Jet of real numbers: h, "
            f"∇h ({n},), ∇²h ({n}, {n}), ∂h/∂t, ∂∇h/∂t ({n},), ∂²h/∂t²"
        )
    if finite and not all(np.isfinite(field).all() for field in fields):
        raise InvalidInputError(f"{barrier.name}: got the jet {jet}, expected finite numbers")
    return Jet._make(jet)


def _is_plain(jet: Jet, n: int) -> bool:
    """Tell in a few microseconds whether a jet is made of finite floats; False may be wrong."""
    h, gradient, hessian, rate, gradient_rate, rate_rate = jet
    arrays = gradient, hessian, gradient_rate
    if not all(type(part) is np.ndarray and part.dtype == np.float64 for part in arrays):
        return False
    if not all(isinstance(part, float) for part in (h, rate, rate_rate)):
        return False
    if gradient.shape != (n,) or hessian.shape != (n, n) or gradient_rate.shape != (n,):
        return False
    sizes = np.vdot(gradient, gradient) + np.vdot(hessian, hessian)
    sizes += np.vdot(gradient_rate, gradient_rate)
    return math.isfinite(sizes + abs(h) + abs(rate) + abs(rate_rate))


def margins(barriers: Sequence[Barrier], margin: ArrayLike) -> Array:
    """Return (m,) what each row reserves between h and zero.

    Args:
        barriers: m safety conditions.
        margin: (m,), or one number for the rows of priority 1 that read the position; a speed
            limit then reserves its own.
    """
    given = np.asarray(margin, dtype=np.float64)
    if given.ndim:
        return given
    return np.array(
        [
            barrier.margin
            if isinstance(barrier, SpeedLimit)
            else float(given) * (barrier.priority == 1 and barrier.reads_position)
            for barrier in barriers
        ]
    )


@njit(cache=True)
def _in_input(gradients: Array, drift: Array, inputs: Array) -> tuple[Array, Array, Array]:
    """Return ``L_g ψ`` (m, n_u), ``L_f ψ`` (m,) and the rows' conditioning (m,).

    It is ``‖L_g ψ‖ / (‖∇ψ‖ ‖g‖)``; a row of none is a constant.

    Args:
        gradients: (m, n) ∇ψ.
        drift: (n,) f.
        inputs: (n, n_u) g.
    """
    a, along = np.zeros((len(gradients), inputs.shape[1])), np.zeros(len(gradients))
    conditioning = np.zeros(len(gradients))
    steer = (inputs * inputs).sum()
    for k in range(len(gradients)):
        whole = reached = 0.0
        for i in range(drift.size):
            along[k] += gradients[k, i] * drift[i]
            whole += gradients[k, i] * gradients[k, i]
        for j in range(inputs.shape[1]):
            for i in range(drift.size):
                a[k, j] += gradients[k, i] * inputs[i, j]
            reached += a[k, j] * a[k, j]
        share = np.sqrt(reached / (whole * steer)) if whole * steer > 0.0 else 0.0
        if share > VANISHED:
            conditioning[k] = share
        else:
            a[k] = 0.0
    return a, along, conditioning
