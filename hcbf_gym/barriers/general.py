"""From barriers to rows for any model: h(x, t) ≥ 0 is preserved by a condition linear in u.

A scene is the tuple of one plant's barriers. `prepare` takes N scenes and returns a `Prepared`,
which holds all that does not depend on the state. Rows are then written at a state of each scene:

- Compiled code has the derivatives of built-in shapes.
- A user's own class returns a `Jet`, from which compiled code makes its row.
- JAX makes the rows of functions, those of one `Group` at once.

`Prepared` assigns each barrier to one of these, and `PackedRows` names the columns of a row.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier, checked, pack, packed_size
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_cache import FunctionCache
from hcbf_gym.barriers.function_group import Group, Instant
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.barriers.prepared import Conditions, Prepared, prepare_scenes
from hcbf_gym.barriers.reaches import Reaches
from hcbf_gym.barriers.relative_degree import Reach
from hcbf_gym.barriers.rows import WIDTH, CbfRows, PackedRows, States
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import (
    InvalidInputError,
    finite_array,
    in_words,
    instance,
    listed,
    reals,
    shown,
)
from hcbf_gym.models.reduced_order import ReducedOrderModel

_NO_JACOBIAN = np.zeros((1, 0, 0))
"""Given to compiled code in the place of ∂f/∂x where no row reads it."""


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
        most: returns the largest a·u of an input u in U, for a (n_u,); None where U is not known.
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
        self.model, self.alpha1, self.alpha2 = model, alpha1, alpha2
        self._max_input_effect = most
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
            kinks: evaluates derivatives at a kink, for the u* that it holds; None without u*.

        Raises:
            InvalidInputError: if no input enters the first or second derivative of a barrier, the
                model has no velocity for a speed limit, or a jet is not made of finite numbers.
        """
        x, margin = reals("x", x), reals("margin", margin)
        scene = listed("barriers", barriers, Barrier)
        states = self._states(x, t)
        prepared = self.prepare([scene] * len(states.x))
        shape = prepared.kind.shape
        rows = PackedRows(np.zeros((*shape, WIDTH + self.model.n_u)))
        margins = margin if margin.ndim else prepared.margins(float(margin))
        rows.margin[...] = _broadcast("margin", margins, shape)
        rows.margin_rate[...] = _broadcast("margin_rate", margin_rate, shape)
        self.write_or_raise(prepared, states, rows, self._kinks if kinks is None else kinks)
        self._check_values(scene, states, rows)
        priority = prepared.barrier_set.priority
        if x.ndim == 1:
            rows, priority = PackedRows(rows.numbers[0]), priority[0]
        self.conditioning = rows.conditioning
        b, h, alpha2_psi = rows.b.copy(), rows.h.copy(), rows.alpha2_psi.copy()
        return CbfRows(rows.a.copy(), b, h, priority, alpha2_psi)

    def _states(self, x: Array, t: object) -> States:
        """Return the states of a call; refuse an x or t of another shape."""
        states = np.atleast_2d(x)
        count, n = len(states), self.model.n
        if states.shape != (count, n) or not count:
            raise InvalidInputError(f"rows: got x of shape {x.shape}, expected ({n},) or (N, {n})")
        return States(states, np.array(_broadcast("t", t, (count,))), *self.model.terms_of(states))

    def _check_values(self, scene: Sequence[Barrier], states: States, rows: PackedRows) -> None:
        """Raise the error of a jet whose h is not finite; functions have raised theirs."""
        for i, k in np.argwhere(~np.isfinite(rows.h)):
            if not isinstance(scene[k], Function):
                jet = scene[k].jet(states.x[i], float(states.t[i]))
                checked(scene[k], jet, self.model.n)

    def write_isolating_errors(
        self, prepared: Prepared, states: States, rows: PackedRows, kinks: Kinks
    ) -> dict[int, str]:
        """Write the rows of N scenes; an error in one scene makes b NaN there and nowhere else.

        All scenes are written at once. If that fails, each is prepared and written alone. The
        errors are returned by their scenes.

        Args:
            prepared: N scenes.
            states: one state for each scene.
            rows: the rows, whose margin and margin_rate are read. All other fields are written.
            kinks: evaluates derivatives at a kink.
        """
        error = self._try_to_write(prepared, states, rows, kinks)
        if not error:
            return {}
        if len(states.x) == 1:
            rows.b[...] = np.nan
            return {0: error}
        errors: dict[int, str] = {}
        for i in range(len(states.x)):
            prepared_scene = self._prepare_again(prepared, i)
            only_i = slice(i, i + 1)
            state = States(*(field[only_i] for field in states))
            # the scene alone may have fewer rows than the longest of all, for which `rows` has room
            scene_rows = PackedRows(rows.numbers[only_i, : prepared_scene.kind.shape[1]])
            error = self._try_to_write(prepared_scene, state, scene_rows, kinks.of_plant(i))
            if error:
                scene_rows.b[...] = np.nan
                errors[i] = error
        return errors

    def _try_to_write(
        self, prepared: Prepared, states: States, rows: PackedRows, kinks: Kinks
    ) -> str:
        """Write the rows of N scenes; return the error that was raised, or ""."""
        try:
            self.write_or_raise(prepared, states, rows, kinks)
        except Exception as error:  # a user's own barrier or model may raise anything
            return in_words(error)
        return ""

    def _prepare_again(self, prepared: Prepared, i: int) -> Prepared:
        """Return scene i of N prepared alone, with the parameters that it has among them."""
        barrier_set = BarrierSet([prepared.barrier_set.listed[i]])
        m = barrier_set.kind.shape[1]
        barrier_set.parameters[:] = prepared.barrier_set.parameters[i : i + 1, :m]
        return prepare_scenes(barrier_set, self.functions, self.reach)

    def write_or_raise(
        self, prepared: Prepared, states: States, rows: PackedRows, kinks: Kinks
    ) -> None:
        """Write the rows of N scenes at one state each; raise the errors of users' own code."""
        jets = self._packed_jets(prepared, states, kinks)
        jacobian = self.model.jacobians_of(states.x) if prepared.needs_jacobian else _NO_JACOBIAN
        some_psi1_is_negative = _core.general_rows(
            *prepared.built_in, jets, *states, jacobian, self.alphas, rows.numbers
        )
        for group in prepared.groups:
            some_psi1_is_negative |= self._write_group(group, prepared, states, rows, kinks)
        if some_psi1_is_negative and self._max_input_effect is not None:
            for i, k in np.argwhere((rows.alpha2_psi < 0.0) & (prepared.degree == 2)):
                row = rows.numbers[i, k]  # of degree 2 with ψ_1 < 0: it is to request a stop
                _core.recover_row(self.alphas, self._max_input_effect(row[WIDTH:]), row)

    def _packed_jets(self, prepared: Prepared, states: States, kinks: Kinks) -> Array:
        """Return (N, m, `packed_size`) the jets of users' own classes; (N, 0, …) without any."""
        count, m = prepared.kind.shape
        jets = np.zeros((count, m if prepared.custom else 0, packed_size(self.model.n)))
        for i, k, barrier in prepared.custom:
            pack(kinks.jet(self.model, barrier, states.x[i], float(states.t[i]), i), jets[i, k])
        return jets

    def _write_group(
        self, group: Group, prepared: Prepared, states: States, rows: PackedRows, kinks: Kinks
    ) -> bool:
        """Write the rows of a group of functions; return whether a ψ_1 of one is below zero."""
        group_places = np.ix_(group.scene_indices, group.places)
        group_rows = PackedRows(rows.numbers[group_places])  # a copy, written back below
        x, t = states.x[group.scene_indices], states.t[group.scene_indices]
        instant = Instant(x, t, group_rows.margin, group_rows.margin_rate)
        jax_rows = group.rows(instant)
        if not math.isfinite(jax_rows.sum()):  # a function is at a kink
            barriers_by_scene = prepared.barrier_set.listed
            jax_rows = group.rows_beside_kinks(instant, jax_rows, kinks, barriers_by_scene)
        degrees = prepared.degree[group.scene_indices[0], group.places]
        some_psi1_is_negative = _core.function_rows(
            jax_rows, degrees, self.alphas[1], group_rows.numbers
        )
        rows.numbers[group_places] = group_rows.numbers
        return some_psi1_is_negative

    def prepare(self, scenes: Sequence[Conditions]) -> Prepared:
        """Return N scenes prepared; the latest ones again, if they hold the same barriers."""
        latest = self._latest  # read once: filters in other threads share these rows
        if latest is None or not latest.is_of(scenes):
            barrier_set = BarrierSet(scenes)
            self._latest = latest = prepare_scenes(barrier_set, self.functions, self.reach)
        return latest

    def reach(self, barrier: Barrier) -> Reach:
        """Return how inputs reach a barrier; see `Reaches.reach_of`."""
        return self._reaches.reach_of(barrier)


def _broadcast(name: str, value: object, shape: tuple[int, ...]) -> Array:
    """Return numbers broadcast to a shape, of which they may lack leading axes."""
    numbers = finite_array(name, value, reals(name, value).shape)
    if numbers.ndim > len(shape) or numbers.shape != shape[len(shape) - numbers.ndim :]:
        raise InvalidInputError(f"{name}: got shape {numbers.shape}, expected {shape}")
    return np.broadcast_to(numbers, shape)
