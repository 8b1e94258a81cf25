"""From barriers to rows for any model: h(x, t) ≥ 0 is preserved by a condition linear in u.

Compiled code has the derivatives of built-in shapes. A user's own class returns a `Jet`, from which
compiled code makes its row. JAX makes the rows of functions, those of one `Group` at once.
`Prepared` assigns each barrier to one of these, and `PackedRows` names the columns of a row.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier, checked
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_cache import FunctionCache
from hcbf_gym.barriers.function_group import Group, Instant
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.barriers.prepared import Conditions, Prepared, prepared
from hcbf_gym.barriers.reaches import Reaches
from hcbf_gym.barriers.relative_degree import Reach
from hcbf_gym.barriers.rows import WIDTH, CbfRows, PackedRows, States
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import (
    InvalidInputError,
    finite_array,
    instance,
    listed,
    reals,
    shown,
)
from hcbf_gym.models.reduced_order import ReducedOrderModel

_NO_JACOBIAN = np.zeros((1, 0, 0))


class GeneralRows:
    r"""Rows ``a·u ≥ b`` for any model and any mix of barriers.

    With r the relative degree, :math:`ψ_0 = h − \text{margin}`,
    :math:`ψ_k = \dot ψ_{k−1} + α_1(ψ_{k−1})` for k < r, and the row requests
    :math:`\dot ψ_{r−1}(x, u) ≥ −α_2(ψ_{r−1})`:

    .. math::
        a = L_g ψ_{r−1}, \qquad b = −α_2(ψ_{r−1}) − L_f ψ_{r−1} − ∂ψ_{r−1}/∂t.

    If r is 2 and ψ_1 < 0, the row requests at least a stop at h = margin, as far as U can (see
    rows.hpp).

    r is the least order at which *any* input appears, at sampled states. Inputs that would appear
    later are not in the row, so that the filter leaves them free; `late_inputs` finds them. Where
    L_g ψ vanishes at a state, a is set to 0: no input helps or harms there, and b > 0 then counts
    as a violation.

    Args:
        model: ẋ = f(x) + g(x)u.
        alpha1: α₁, applied to every ψ but the last.
        alpha2: α₂, applied to the last ψ.
        most: a (n_u,) → the largest a·u of an input in U; None where U is not known.
        alpha_speed: α of speed limits; α₂ unless given.

    Attributes:
        alphas: (3, 4) α₁, α₂ and α of speed limits, see `ClassK.parameters`.
        conditioning: (m,) of the latest rows, from 0 to 1: 0 where the input does not matter, small
            where L_g ψ nearly vanishes, less than 1 at a kink of a function.
        functions: compiles the rows of functions.

    Source: section II-C of the paper, with the high-order form for L_g h = 0.
    """

    def __init__(
        self,
        model: ReducedOrderModel,
        alpha1: ClassK,
        alpha2: ClassK,
        most: Callable[[Array], float] | None = None,
        alpha_speed: ClassK | None = None,
    ) -> None:
        instance("model", model, ReducedOrderModel)
        instance("alpha1", alpha1, ClassK)
        instance("alpha2", alpha2, ClassK)
        if most is not None and not callable(most):
            raise InvalidInputError(f"most: got {shown(most)}, expected a function of a (n_u,)")
        alpha_speed = alpha2 if alpha_speed is None else alpha_speed
        instance("alpha_speed", alpha_speed, ClassK)
        self.model, self.alpha1, self.alpha2, self._most = model, alpha1, alpha2, most
        self.functions = FunctionCache(model, alpha1, alpha2)
        self.alphas = np.stack([alpha.parameters() for alpha in (alpha1, alpha2, alpha_speed)])
        self._reaches = Reaches(model, self.functions)
        self._latest: Prepared | None = None
        self.conditioning = np.ones(0)
        self._kinks = Kinks()

    def __call__(
        self,
        barriers: Sequence[Barrier],
        x: Array,
        t: Any = 0.0,
        margin: ArrayLike = 0.0,
        margin_rate: ArrayLike = 0.0,
        kinks: Kinks | None = None,
    ) -> CbfRows:
        """Return the rows of one state, or of N.

        Args:
            barriers: m safety conditions.
            x: (n,) state; (N, n) for N states, and every field has N rows.
            t: time [s]; (N,) for N states.
            margin: what rows reserve between h and zero: (m,), or one number for the rows of
                priority 1 that read the position.
            margin_rate: (m,) or one number, d margin/dt.
            kinks: evaluates derivatives at a kink, for a filter; None for one without u*.

        Raises:
            InvalidInputError: if no input enters the first or second derivative of a barrier, the
                model has no velocity for a speed limit, or a jet is not made of finite numbers.
        """
        x, margin = reals("x", x), reals("margin", margin)
        conditions = listed("barriers", barriers, Barrier)
        states = self._states(x, t)
        scenes = self.prepare([conditions] * len(states.x))
        shape = scenes.kind.shape
        rows = PackedRows(np.zeros((*shape, WIDTH + self.model.n_u)))
        reserved = margin if margin.ndim else scenes.margins(float(margin))
        rows.margin[...] = _fitted("margin", reserved, shape)
        rows.margin_rate[...] = _fitted("margin_rate", margin_rate, shape)
        self._write(scenes, states, rows, self._kinks if kinks is None else kinks)
        self._check_values(conditions, states, rows)
        ranks = scenes.scenes.priority
        if x.ndim == 1:
            rows, ranks = PackedRows(rows.numbers[0]), ranks[0]
        self.conditioning = rows.conditioning
        b, h, alpha2_psi = rows.b.copy(), rows.h.copy(), rows.alpha2_psi.copy()
        return CbfRows(rows.a.copy(), b, h, ranks, alpha2_psi)

    def _states(self, x: Array, t: object) -> States:
        """Return the states of a call; refuse an x or t of another shape."""
        states = np.atleast_2d(x)
        count, n = len(states), self.model.n
        if states.shape != (count, n) or not count:
            raise InvalidInputError(f"rows: got x of shape {x.shape}, expected ({n},) or (N, {n})")
        return States(states, np.array(_fitted("t", t, (count,))), *self.model.terms_of(states))

    def _check_values(self, barriers: Sequence[Barrier], states: States, rows: PackedRows) -> None:
        """Raise the error of a jet whose h is not finite; functions have raised theirs."""
        for i, k in np.argwhere(~np.isfinite(rows.h)):
            if not isinstance(barriers[k], Function):
                jet = barriers[k].jet(states.x[i], float(states.t[i]))
                checked(barriers[k], jet, self.model.n)

    def write(self, scenes: Prepared, states: States, rows: PackedRows, kinks: Kinks) -> None:
        """Write the rows of N states; where a barrier raises an error, b is NaN in its scene.

        Args:
            scenes: the barriers of N scenes.
            states: one state for each scene.
            rows: the rows, whose margin and margin_rate are read. All other fields are written.
            kinks: evaluates derivatives at a kink.
        """
        try:
            self._write(scenes, states, rows, kinks)
        except Exception:  # a user's own barrier or model may raise anything
            if len(states.x) == 1:
                rows.b[...] = np.nan
                return
            for i in range(len(states.x)):
                self._write_alone(i, scenes, states, rows, kinks)

    def _write_alone(
        self, i: int, scenes: Prepared, states: States, rows: PackedRows, kinks: Kinks
    ) -> None:
        """Write the rows of scene i, so that an error of another scene does not matter to it."""
        only_i = slice(i, i + 1)
        scene = BarrierSet([scenes.scenes.listed[i]])
        m = scene.kind.shape[1]  # fewer than in the batch, which fills up shorter scenes
        scene.parameters[:] = scenes.scenes.parameters[only_i, :m]
        prepared_scene = prepared(scene, self.functions, self.reach)
        state = States(*(field[only_i] for field in states))
        scene_rows = PackedRows(rows.numbers[only_i, :m])
        self.write(prepared_scene, state, scene_rows, kinks.of_plant(i))

    def _write(self, scenes: Prepared, states: States, rows: PackedRows, kinks: Kinks) -> None:
        """Write the rows of N states; raise the errors of users' own code."""
        jets = self._jets(scenes, states, kinks)
        jacobian = self.model.jacobians_of(states.x) if scenes.needs_jacobian else _NO_JACOBIAN
        is_late = _core.general_rows(
            *scenes.built_in, jets, *states, jacobian, self.alphas, rows.numbers
        )
        for group in scenes.groups:
            is_late |= self._write_functions(group, scenes, states, rows, kinks)
        if is_late and self._most is not None:
            for i, k in np.argwhere((rows.alpha2_psi < 0.0) & (scenes.degree == 2)):
                row = rows.numbers[i, k]
                _core.recover_row(self.alphas, self._most(row[WIDTH:]), row)

    def _jets(self, scenes: Prepared, states: States, kinks: Kinks) -> Array:
        """Return (N, m, 3 + 2n + n²) the jets of users' own classes; (N, 0, …) without any.

        A jet is packed as h, ∂h/∂t, ∂²h/∂t², ∇h, ∂∇h/∂t and ∇²h.
        """
        n, (count, m) = self.model.n, scenes.kind.shape
        jets = np.zeros((count, m if scenes.custom else 0, 3 + 2 * n + n * n))
        for i, k, barrier in scenes.custom:
            jet = kinks.jet(self.model, barrier, states.x[i], float(states.t[i]), i)
            packed = jets[i, k]
            packed[:3] = jet.h, jet.rate, jet.rate_rate
            packed[3 : 3 + n] = jet.gradient
            packed[3 + n : 3 + 2 * n] = jet.gradient_rate
            packed[3 + 2 * n :] = np.ravel(jet.hessian)
        return jets

    def _write_functions(
        self, group: Group, scenes: Prepared, states: States, rows: PackedRows, kinks: Kinks
    ) -> bool:
        """Write the rows of a group; return whether a ψ_1 of one is below zero."""
        of_group = np.ix_(group.scenes, group.places)
        group_rows = PackedRows(rows.numbers[of_group])
        x, t = states.x[group.scenes], states.t[group.scenes]
        at = Instant(x, t, group_rows.margin, group_rows.margin_rate)
        by_jax = group.rows(at)
        if not math.isfinite(by_jax.sum()):
            by_jax = group.rows_beside(at, by_jax, kinks, scenes.scenes.listed)
        degrees = scenes.degree[group.scenes[0], group.places]
        is_late = _core.function_rows(by_jax, degrees, self.alphas[1], group_rows.numbers)
        rows.numbers[of_group] = group_rows.numbers
        return is_late

    def prepare(self, scenes: Sequence[Conditions]) -> Prepared:
        """Return N scenes prepared; the latest ones again, if they hold the same barriers."""
        latest = self._latest  # read once: filters in other threads share these rows
        if latest is None or not latest.is_of(scenes):
            self._latest = latest = prepared(BarrierSet(scenes), self.functions, self.reach)
        return latest

    def reach(self, barrier: Barrier) -> Reach:
        """Return how inputs reach a barrier; see `Reaches.reach_of`."""
        return self._reaches.reach_of(barrier)


def _fitted(name: str, value: object, shape: tuple[int, ...]) -> Array:
    """Return numbers broadcast to a shape, of which they may lack leading axes."""
    numbers = finite_array(name, value, reals(name, value).shape)
    if numbers.ndim > len(shape) or numbers.shape != shape[len(shape) - numbers.ndim :]:
        raise InvalidInputError(f"{name}: got shape {numbers.shape}, expected {shape}")
    return np.broadcast_to(numbers, shape)
