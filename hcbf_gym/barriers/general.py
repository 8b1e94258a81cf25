"""From barriers to rows for any model: h(x, t) ≥ 0 is preserved by a condition linear in u."""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.barrier import Barrier, Jet
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_cache import FunctionCache
from hcbf_gym.barriers.general_kernels import (
    CONDITIONING,
    ELSEWHERE,
    MARGIN,
    RATE,
    WIDTH,
    Scene,
    jet_width,
    pack,
)
from hcbf_gym.barriers.jets import checked, is_plain
from hcbf_gym.barriers.kinks import SMOOTH, Kinks
from hcbf_gym.barriers.many import Several
from hcbf_gym.barriers.mapped import Mapped
from hcbf_gym.barriers.prepared import (
    Group,
    Prepared,
    are_same,
    blocks,
    filled,
    function_at,
    margins,
)
from hcbf_gym.barriers.relative_degree import Reach, reach_by_jets, samples
from hcbf_gym.barriers.rows import ALPHA2_PSI, B, CbfRows, H
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
OF_H = -4
"""Where the rows of functions have h."""
_NO_JACOBIAN = np.zeros((1, 0, 0))


class GeneralRows:
    r"""Rows ``a·u ≥ b`` for any model and any mix of barriers.

    With r the relative degree, :math:`ψ_0 = h − \text{margin}`,
    :math:`ψ_k = \dot ψ_{k−1} + α_1(ψ_{k−1})` for k < r, and the row asks for
    :math:`\dot ψ_{r−1}(x, u) ≥ −α_2(ψ_{r−1})`:

    .. math::
        a = L_g ψ_{r−1}, \qquad b = −α_2(ψ_{r−1}) − L_f ψ_{r−1} − ∂ψ_{r−1}/∂t.

    Where r is 2 and ψ_1 below zero, the row asks at least for a stop at h = margin, if U can (see
    rows.hpp).

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
        prepared = self.prepare([tuple(barriers)] * count)
        out = np.zeros((count, m, WIDTH + self.model.n_u))
        kept = kept if kept.ndim else prepared.margins(float(kept))
        out[..., MARGIN] = _fitted("margin", kept, (count, m))
        out[..., RATE] = _fitted("margin_rate", margin_rate, (count, m))
        times = np.array(_fitted("t", t, (count,)))
        self._write(prepared, states, times, self.model.terms_of(states), out, kinks)
        if not np.isfinite(out[..., H]).all():
            for i, k in zip(*np.nonzero(~np.isfinite(out[..., H])), strict=True):
                barrier = barriers[k]
                if not isinstance(barrier, Function):
                    checked(barrier, barrier.jet(states[i], float(times[i])), self.model.n)
        out, ranks = (out[0], prepared.priority[0]) if x.ndim == 1 else (out, prepared.priority)
        self.conditioning = out[..., CONDITIONING]
        a, numbers = out[..., WIDTH:].copy(), (out[..., q].copy() for q in (B, H, ALPHA2_PSI))
        b, h, alpha2_psi = numbers
        return CbfRows(a, b, h, ranks, alpha2_psi)

    def write(
        self,
        prepared: Prepared,
        x: Array,
        t: Array,
        terms: tuple[Array, Array],
        out: Array,
        kinks: tuple[Kinks, int] | None = None,
    ) -> None:
        """Write the rows of N states; NaN into those of scenes that give none.

        Args:
            prepared: the barriers of N scenes.
            x: (N, n) states.
            t: (N,) times [s].
            terms: f (N, n) and g (N, n, n_u) at x.
            out: (N, m, WIDTH + n_u) with m and ṁ, see `general_kernels.MARGIN`.
            kinks: as in a call.
        """
        try:
            self._write(prepared, x, t, terms, out, kinks)
        except UNREADABLE:
            if len(x) == 1:
                out[..., B] = np.nan
                return
            for i in range(len(x)):
                one = slice(i, i + 1)
                part = self.prepared([prepared.scenes[i]])
                part.scene.parameters[:] = prepared.scene.parameters[one]
                here = (self.kinks, i) if kinks is None else (kinks[0], kinks[1] + i)
                self.write(part, x[one], t[one], (terms[0][one], terms[1][one]), out[one], here)

    def _write(
        self,
        prepared: Prepared,
        x: Array,
        t: Array,
        terms: tuple[Array, Array],
        out: Array,
        kinks: tuple[Kinks, int] | None,
    ) -> None:
        """Write the rows of N states; what users' own code raises is raised."""
        n, (f, g) = self.model.n, terms
        known, first = kinks or (self.kinks, 0)
        count, m = prepared.priority.shape
        jets = np.zeros((count, m if prepared.custom else 0, jet_width(n)))
        for i, k, barrier in prepared.custom:
            pack(self._jet(barrier, x[i], float(t[i]), (known, first + i)), jets[i, k])
        jacobian = _NO_JACOBIAN
        if prepared.turns:
            jacobian = self.model.jacobians_of(x)
        lags = _core.general_rows(*prepared.scene, jets, x, t, f, g, jacobian, self._alphas, out)
        for group in prepared.groups:
            scenes, places, rows = group
            here = np.ix_(scenes, places)
            reserved = out[here]
            made = rows(x[scenes], t[scenes], reserved[..., MARGIN], reserved[..., RATE])
            if not math.isfinite(made.sum()):
                made = self._beside(prepared, group, made, (x, t, reserved), (known, first))
            degrees = prepared.scene.degree[scenes[0], places]
            lags |= _core.function_rows(made, degrees, self._alphas[1], reserved)
            out[here] = reserved
        if lags and self._most is not None:
            self._recover(prepared, self._most, out)

    def _jet(self, barrier: Barrier, x: Array, t: float, kinks: tuple[Kinks, int]) -> Jet:
        """Return h and its derivatives; those beside x where they are not finite there.

        Raises:
            InvalidInputError: if the barrier returns no jet, h is not finite, or neither are the
                derivatives beside x.
        """
        jet, n = barrier.jet(x, t), self.model.n
        if isinstance(jet, Jet) and is_plain(jet, n):
            return jet
        jet = checked(barrier, jet, n, finite=False)
        if all(np.isfinite(field).all() for field in jet):
            return jet
        if not np.isfinite(jet.h):
            raise InvalidInputError(f"{barrier.name}: got the jet {jet}, expected finite numbers")
        known, i = kinks
        for beside in known.beside(self.model, x, i):
            other = checked(barrier, barrier.jet(beside, t), n, finite=False)
            if all(np.isfinite(field).all() for field in other):
                known.warn(barrier, x)
                return other._replace(h=jet.h)
        raise InvalidInputError(
            f"{barrier.name}: the gradient of h is not finite at x = {x.tolist()}; {SMOOTH}"
        )

    def _beside(
        self,
        prepared: Prepared,
        group: Group,
        made: Array,
        at: tuple[Array, Array, Array],
        kinks: tuple[Kinks, int],
    ) -> Array:
        """Return rows of functions; those beside x where they are not finite there.

        Args:
            prepared: the barriers of N scenes.
            group: the functions.
            made: their rows, see `FunctionRows`.
            at: x (N, n) and t (N,) of all scenes [s], and what rows of the group reserve.
            kinks: as `_write` takes it.
        """
        (x, t, reserved), (known, first), made = at, kinks, made.copy()
        for j, k in np.argwhere(~np.isfinite(made).all(axis=2)):
            i = int(group.scenes[j])
            for beside in known.beside(self.model, x[i], first + i):
                moved = x[group.scenes]
                moved[j] = beside
                times = t[group.scenes]
                row = group.rows(moved, times, reserved[..., MARGIN], reserved[..., RATE])[j, k]
                if np.isfinite(row).all():
                    known.warn(prepared.scenes[i][group.places[k]], x[i])
                    h, made[j, k] = made[j, k, OF_H], row
                    made[j, k, OF_H] = h
                    break
        return made

    def _recover(self, prepared: Prepared, most: Callable[[Array], float], out: Array) -> None:
        """Let rows ask for a stop where ψ_1 is below zero."""
        for i, k in np.argwhere((out[..., ALPHA2_PSI] < 0.0) & (prepared.scene.degree == 2)):
            row = out[i, k]
            _core.recover_row(self._alphas, most(row[WIDTH:]), row)

    def prepare(self, scenes: Sequence[tuple[Barrier, ...]]) -> Prepared:
        """Return what is known of N scenes, looked up once while these are the same."""
        kept = self._latest  # filters in other threads share these rows
        if kept is None or len(kept.scenes) != len(scenes) or not are_same(kept.scenes, scenes):
            self._latest = kept = self.prepared(scenes)
        return kept

    def prepared(self, scenes: Sequence[tuple[Barrier, ...]]) -> Prepared:
        """Return what is known of the barriers of N scenes.

        Raises:
            InvalidInputError: if no input reaches one.
        """
        count = len(scenes)
        if count > 1 and all(scene is scenes[0] for scene in scenes):
            return self._repeated(self.prepared(scenes[:1]), count)
        groups = self._groups(scenes)
        of_functions = {
            (int(i), int(k)): reach
            for group in groups
            for i in group.scenes
            for k, reach in zip(group.places, group.rows.reaches, strict=True)
        }
        reaches = [
            [of_functions.get((i, k)) or self.reach(barrier) for k, barrier in enumerate(scene)]
            for i, scene in enumerate(scenes)
        ]
        degrees = [[reach.degree for reach in one] for one in reaches]
        kind, parameters = blocks(scenes)
        degree = filled(degrees, kind.shape, np.int64)
        custom = [(int(i), int(k), scenes[i][k]) for i, k in np.argwhere(kind == layout.CUSTOM)]
        ranks = [[barrier.priority for barrier in scene] for scene in scenes]
        zero, one = (
            filled([margins(scene, m).tolist() for scene in scenes], kind.shape, np.float64)
            for m in (0.0, 1.0)
        )
        return Prepared(
            tuple(scenes),
            groups,
            custom,
            Scene(kind, parameters, degree),
            reaches,
            bool((degree[kind != ELSEWHERE] == 2).any()),
            filled(ranks, kind.shape, np.int64),
            zero,
            one - zero,
        )

    def _repeated(self, one: Prepared, count: int) -> Prepared:
        """Return what is known of N scenes that are the same."""
        kind, parameters, degree = one.scene
        everywhere = np.arange(count)
        return one._replace(
            scenes=one.scenes * count,
            groups=self._groups(one.scenes * count) if one.groups else [],
            custom=[(int(i), k, barrier) for i in everywhere for _, k, barrier in one.custom],
            scene=Scene(
                np.repeat(kind, count, axis=0),
                np.repeat(parameters, count, axis=0),
                np.repeat(degree, count, axis=0),
            ),
            priority=np.repeat(one.priority, count, axis=0),
            least=np.repeat(one.least, count, axis=0),
            share=np.repeat(one.share, count, axis=0),
        )

    def _groups(self, scenes: Sequence[tuple[Barrier, ...]]) -> list[Group]:
        """Return the functions of N scenes, those of the same signatures together."""
        found: dict[tuple[tuple[int, ...], tuple[object, ...]], list[int]] = {}
        for i, scene in enumerate(scenes):
            places = tuple(k for k, barrier in enumerate(scene) if isinstance(barrier, Function))
            if places:
                key = places, tuple(function_at(scene, k).signature for k in places)
                found.setdefault(key, []).append(i)
        return [
            Group(
                np.array(members),
                np.array(places),
                self.functions.rows([[function_at(scenes[i], k) for k in places] for i in members]),
            )
            for (places, _), members in found.items()
        ]

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
            return self.functions.rows([[barrier]]).reaches[0]
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
    """Return numbers, or one number for all of them, in a shape.

    Raises:
        InvalidInputError: if they do not fit.
    """
    numbers = finite_array(name, value, reals(name, value).shape)
    if numbers.ndim > len(shape) or numbers.shape != shape[len(shape) - numbers.ndim :]:
        raise InvalidInputError(f"{name}: got shape {numbers.shape}, expected {shape}")
    return np.broadcast_to(numbers, shape)


def check_barriers(barriers: Any) -> tuple[Barrier, ...]:
    """Return barriers as a tuple, what stands for several of them one by one.

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
