"""From barriers to rows for any model: h(x, t) ≥ 0 is preserved by a condition linear in u."""

import itertools
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
from hcbf_gym.barriers.function_cache import FunctionCache, Group
from hcbf_gym.barriers.kinks import Kinks
from hcbf_gym.barriers.many import Several
from hcbf_gym.barriers.mapped import Mapped
from hcbf_gym.barriers.prepared import Conditions, Prepared, prepared
from hcbf_gym.barriers.relative_degree import Reach, reach_by_jets, samples
from hcbf_gym.barriers.rows import ALPHA2_PSI, CONDITIONING, MARGIN, RATE, WIDTH, B, CbfRows, H
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.shapes import SHAPES, HalfPlane
from hcbf_gym.barriers.speed_limit import SpeedLimit
from hcbf_gym.errors import (
    UNREADABLE,
    InvalidInputError,
    UnreachableError,
    finite_array,
    instance,
    listed,
    reals,
    shown,
)
from hcbf_gym.models.reduced_order import ReducedOrderModel

_BOUNDED = {*SHAPES} - {HalfPlane}  # which read both positions, whatever their numbers are
_OF_H = -4  # where the rows of functions have h
_NO_JACOBIAN = np.zeros((1, 0, 0))


class GeneralRows:
    r"""Rows ``a·u ≥ b`` for any model and any mix of barriers.

    With r the relative degree, :math:`ψ_0 = h − \text{margin}`,
    :math:`ψ_k = \dot ψ_{k−1} + α_1(ψ_{k−1})` for k < r, and the row requests
    :math:`\dot ψ_{r−1}(x, u) ≥ −α_2(ψ_{r−1})`:

    .. math::
        a = L_g ψ_{r−1}, \qquad b = −α_2(ψ_{r−1}) − L_f ψ_{r−1} − ∂ψ_{r−1}/∂t.

    Where r is 2 and ψ_1 below zero, the row requests at least a stop at h = margin, if U can (see
    rows.hpp).

    r is the least order at which *any* input appears, at sampled states: inputs that would appear
    later are not in the row, so that the filter leaves them free; `late_inputs` finds them. Where a
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
        kinks: where derivatives are taken that are not finite at x.

    Source: section II-C of the paper, with the high-order form for L_g h = 0.
    """

    def __init__(
        self,
        model: ReducedOrderModel,
        alpha1: ClassK,
        alpha2: ClassK,
        most: Callable[[Array], float] | None = None,
    ) -> None:
        instance("model", model, ReducedOrderModel)
        instance("alpha1", alpha1, ClassK)
        instance("alpha2", alpha2, ClassK)
        if most is not None and not callable(most):
            raise InvalidInputError(f"most: got {shown(most)}, expected a function of a (n_u,)")
        self.model, self.alpha1, self.alpha2, self._most = model, alpha1, alpha2, most
        self.functions = FunctionCache(model, alpha1, alpha2)
        self._alphas = np.stack((alpha1.parameters(), alpha2.parameters()))
        self._reaches: dict[tuple[type[Barrier], bytes], Reach] = {}
        self._somewhere = samples(model)[0][0]
        self._latest: Prepared | None = None
        self.conditioning = np.ones(0)
        self.kinks = Kinks()

    def __call__(
        self,
        barriers: Sequence[Barrier],
        x: Array,
        t: Any = 0.0,
        margin: ArrayLike = 0.0,
        margin_rate: ArrayLike = 0.0,
        kinks: tuple[Kinks, int] | None = None,
    ) -> CbfRows:
        """Return the rows of one state, or of N.

        Args:
            barriers: m safety conditions.
            x: (n,) state; (N, n) for N states, and every field has N rows.
            t: time [s]; (N,) for N states.
            margin: what rows reserve between h and zero: (m,), or one number for the rows of
                priority 1 that read the position.
            margin_rate: (m,) or one number, d margin/dt.
            kinks: those of a filter, and the number of the first plant there; None for `kinks`.

        Raises:
            InvalidInputError: if no input reaches a barrier by the second derivative, the model has
                no velocity for a speed limit, or a jet is not made of finite numbers.
        """
        x, kept = reals("x", x), reals("margin", margin)
        m = len(listed("barriers", barriers, Barrier))
        states = np.atleast_2d(x)
        count = len(states)
        if states.shape != (count, self.model.n) or not count:
            raise InvalidInputError(
                f"rows: got x of shape {x.shape}, expected ({self.model.n},) or (N, {self.model.n})"
            )
        scenes = self.prepare([tuple(barriers)] * count)
        out = np.zeros((count, m, WIDTH + self.model.n_u))
        kept = kept if kept.ndim else scenes.margins(float(kept))
        out[..., MARGIN] = _fitted("margin", kept, (count, m))
        out[..., RATE] = _fitted("margin_rate", margin_rate, (count, m))
        times = np.array(_fitted("t", t, (count,)))
        self._write(scenes, states, times, self.model.terms_of(states), out, kinks)
        for i, k in np.argwhere(~np.isfinite(out[..., H])):
            if not isinstance(barriers[k], Function):
                checked(barriers[k], barriers[k].jet(states[i], float(times[i])), self.model.n)
        ranks = scenes.scenes.priority
        out, ranks = (out[0], ranks[0]) if x.ndim == 1 else (out, ranks)
        self.conditioning = out[..., CONDITIONING]
        b, h, alpha2_psi = (out[..., column].copy() for column in (B, H, ALPHA2_PSI))
        return CbfRows(out[..., WIDTH:].copy(), b, h, ranks, alpha2_psi)

    def write(
        self,
        scenes: Prepared,
        x: Array,
        t: Array,
        terms: tuple[Array, Array],
        out: Array,
        kinks: tuple[Kinks, int] | None = None,
    ) -> None:
        """Write the rows of N states; NaN into those of scenes that give none.

        Args:
            scenes: their barriers.
            x: (N, n) states.
            t: (N,) times [s].
            terms: f (N, n) and g (N, n, n_u) at x.
            out: (N, m, WIDTH + n_u) with m and ṁ, see `rows.MARGIN`.
            kinks: as in a call.
        """
        try:
            self._write(scenes, x, t, terms, out, kinks)
        except UNREADABLE:
            if len(x) == 1:
                out[..., B] = np.nan
                return
            for i in range(len(x)):
                one = slice(i, i + 1)
                scene = BarrierSet([scenes.scenes.listed[i]])
                m = scene.kind.shape[1]  # a batch fills up shorter scenes
                scene.parameters[:] = scenes.scenes.parameters[one, :m]
                part = prepared(scene, self.functions, self.reach)
                here = (self.kinks, i) if kinks is None else (kinks[0], kinks[1] + i)
                self.write(part, x[one], t[one], (terms[0][one], terms[1][one]), out[one, :m], here)

    def _write(
        self,
        scenes: Prepared,
        x: Array,
        t: Array,
        terms: tuple[Array, Array],
        out: Array,
        kinks: tuple[Kinks, int] | None,
    ) -> None:
        """Write the rows of N states; what users' own code raises is raised."""
        n, (f, g) = self.model.n, terms
        known, first = kinks or (self.kinks, 0)
        count, m = scenes.kind.shape
        jets = np.zeros((count, m if scenes.custom else 0, 3 + 2 * n + n * n))
        for i, k, barrier in scenes.custom:
            jet = known.jet(self.model, barrier, x[i], float(t[i]), first + i)
            jets[i, k, :3] = jet.h, jet.rate, jet.rate_rate
            jets[i, k, 3 : 3 + n], jets[i, k, 3 + n : 3 + 2 * n] = jet.gradient, jet.gradient_rate
            jets[i, k, 3 + 2 * n :] = np.ravel(jet.hessian)
        jacobian = self.model.jacobians_of(x) if scenes.turns else _NO_JACOBIAN
        lags = _core.general_rows(*scenes.built_in, jets, x, t, f, g, jacobian, self._alphas, out)
        for group in scenes.groups:
            here = np.ix_(group.scenes, group.places)
            reserved, at = out[here], (x[group.scenes], t[group.scenes])
            made = group.rows(*at, reserved[..., MARGIN], reserved[..., RATE])
            if not math.isfinite(made.sum()):
                made = self._beside(scenes, group, made, (x, t, reserved), (known, first))
            degrees = scenes.degree[group.scenes[0], group.places]
            lags |= _core.function_rows(made, degrees, self._alphas[1], reserved)
            out[here] = reserved
        if lags and self._most is not None:  # rows request a stop where ψ_1 is below zero
            for i, k in np.argwhere((out[..., ALPHA2_PSI] < 0.0) & (scenes.degree == 2)):
                _core.recover_row(self._alphas, self._most(out[i, k, WIDTH:]), out[i, k])

    def _beside(
        self,
        scenes: Prepared,
        group: Group,
        made: Array,
        at: tuple[Array, Array, Array],
        kinks: tuple[Kinks, int],
    ) -> Array:
        """Return rows of a group of functions; those beside x where they are not finite there.

        `at` has x (N, n) and t (N,) of all scenes [s], and what the rows reserve.
        """
        (x, t, reserved), (known, first), made = at, kinks, made.copy()
        listed: Any = scenes.scenes.listed
        for j, k in np.argwhere(~np.isfinite(made).all(axis=2)):
            i = int(group.scenes[j])
            for beside in known.beside(self.model, x[i], first + i):
                moved = x[group.scenes]
                moved[j] = beside
                times = t[group.scenes]
                row = group.rows(moved, times, reserved[..., MARGIN], reserved[..., RATE])[j, k]
                if np.isfinite(row).all():
                    known.warn(listed[i][group.places[k]], x[i])
                    h, made[j, k] = made[j, k, _OF_H], row
                    made[j, k, _OF_H] = h
                    break
        return made

    def prepare(self, scenes: Sequence[Conditions]) -> Prepared:
        """Return what is known of N scenes, looked up once while these are the same.

        Raises:
            InvalidInputError: if no input reaches a barrier.
        """
        kept = self._latest  # filters in other threads share these rows
        if kept is None or not kept.is_of(scenes):
            self._latest = kept = prepared(BarrierSet(scenes), self.functions, self.reach)
        return kept

    def reach(self, barrier: Barrier) -> Reach:
        """Return how inputs reach a barrier.

        Raises:
            InvalidInputError: if none has appeared in the second derivative, or the barrier is a
                speed limit and the model has no velocity.
        """
        is_bounded = type(barrier) in _BOUNDED
        key = type(barrier), b""
        if is_bounded and key in self._reaches:
            return self._reaches[key]
        if isinstance(barrier, Function):
            return self.functions.groups([[barrier]])[0].kernel.reaches[0]
        if isinstance(barrier, SpeedLimit) and self.model.velocity_at != 2:
            raise InvalidInputError(
                f"{barrier.name}: got a speed limit for {self.model}, expected a model with its "
                "velocity in x[2:4]"
            )
        try:
            jet = checked(barrier, barrier.jet(self._somewhere, 0.0), self.model.n, finite=False)
        except InvalidInputError as error:
            raise UnreachableError(str(error)) from error
        if not is_bounded:
            key = type(barrier), (jet.gradient != 0.0).tobytes()
        if key not in self._reaches:
            self._reaches[key] = reach_by_jets(barrier, self.model)
        return self._reaches[key]


def _fitted(name: str, value: object, shape: tuple[int, ...]) -> Array:
    """Return numbers, or one number for all of them, in a shape."""
    numbers = finite_array(name, value, reals(name, value).shape)
    if numbers.ndim > len(shape) or numbers.shape != shape[len(shape) - numbers.ndim :]:
        raise InvalidInputError(f"{name}: got shape {numbers.shape}, expected {shape}")
    return np.broadcast_to(numbers, shape)


def check_barriers(barriers: Any) -> tuple[Barrier, ...]:
    """Return barriers as a tuple, those of a `Several` one by one.

    Raises:
        InvalidInputError: if they are no sequence of barriers.
    """
    listed = isinstance(barriers, Sequence) and not isinstance(barriers, str)
    each = [b.conditions if isinstance(b, Several) else (b,) for b in barriers] if listed else []
    own: tuple[Any, ...] = tuple(itertools.chain.from_iterable(each))
    if not listed or not all(isinstance(b, Barrier) for b in own):
        raise InvalidInputError(
            f"barriers: got {barriers!r}, expected a sequence of objects of classes derived from "
            "hcbf_gym.barriers.Barrier"
        )
    mapped = [barrier.name for barrier in own if isinstance(barrier, Mapped)]
    if mapped:
        raise InvalidInputError(
            f"barriers: got the classes {mapped} of a map, expected them for a plant of the planar "
            "double integrator: only its rows look beyond the nearest piece"
        )
    return own
