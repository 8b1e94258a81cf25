"""From barriers to rows for any model: h(x, t) ≥ 0 is preserved by a condition linear in u."""

import itertools
import math
import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import general_kernels, layout
from hcbf_gym.barriers.barrier import Barrier, Jet
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.function import Function
from hcbf_gym.barriers.function_cache import FunctionCache, SeparateRows
from hcbf_gym.barriers.function_rows import FunctionRows
from hcbf_gym.barriers.general_kernels import (
    ALPHA2_PSI,
    CONDITIONING,
    ELSEWHERE,
    B,
    H,
    Scene,
    Terms,
    pack,
    width,
)
from hcbf_gym.barriers.many import Several
from hcbf_gym.barriers.mapped import Mapped
from hcbf_gym.barriers.relative_degree import Reach, reach_by_jets, samples
from hcbf_gym.barriers.row_kernels import late
from hcbf_gym.barriers.rows import CbfRows
from hcbf_gym.barriers.shape import Shape
from hcbf_gym.barriers.shapes import SHAPES
from hcbf_gym.barriers.speed_limit import SpeedLimit
from hcbf_gym.errors import InvalidInputError, finite_array
from hcbf_gym.models.reduced_order import ReducedOrderModel

BUILT_IN = (*SHAPES, SpeedLimit)
"""What compiled code reads; a user's own class may derive from one and change it."""
_NO_JACOBIAN = np.zeros((1, 0, 0))


class Prepared(NamedTuple):
    """Barriers, with what stays the same from state to state.

    Attributes:
        barriers: m of them.
        own: places of those that are functions.
        functions: what makes the rows of these; None if there are none.
        custom: place and barrier of users' own classes.
        scene: the others, as compiled code reads them.
        reaches: (m,) how inputs reach each of them.
        turns: whether an input enters the second derivative of a barrier that is no function.
        priority: (m,).
        least: (m,) what a row reserves by itself: a speed limit's margin.
        share: (m,) how much of a margin on the position a row reserves.
    """

    barriers: tuple[Barrier, ...]
    own: list[int]
    functions: FunctionRows | SeparateRows | None
    custom: list[tuple[int, Barrier]]
    scene: Scene
    reaches: list[Reach]
    turns: bool
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
        self._alphas = np.stack((alpha1.parameters(), alpha2.parameters()))
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
        terms: tuple[Array, Array] | None = None,
    ) -> CbfRows:
        """Return the rows of one state.

        Args:
            barriers: m safety conditions.
            x: (n,) state; (N, n) where all barriers are functions, and every field has N rows.
            t: time [s]; (N,) for N states.
            margin: what rows reserve between h and zero: (m,), or one number for the rows of
                priority 1 that read the position.
            margin_rate: (m,) or one number, d margin/dt.
            terms: f (n,) and g (n, n_u) at x, where they are known already.

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
        if x.shape != (self.model.n,) or kept.shape != prepared.least.shape:
            raise InvalidInputError(
                f"rows: got x of shape {x.shape} and margins of shape {kept.shape}, expected "
                f"({self.model.n},) and {prepared.least.shape}"
            )
        terms = self.model.terms(x) if terms is None else terms
        reserved = np.array((kept, rates))[:, None]
        rows, self.conditioning = self._from_jets(prepared, x, t, reserved, terms)
        if prepared.functions is not None:
            own = prepared.own
            functions, self.conditioning[own] = prepared.functions(x, t, kept[own], rates[own])
            rows.a[own], rows.b[own], rows.h[own] = functions.a, functions.b, functions.h
            if rows.alpha2_psi is not None:
                rows.alpha2_psi[own] = functions.alpha2_psi
        return self._recovering(prepared, rows, kept)

    def _recovering(self, prepared: Prepared, rows: CbfRows, margin: Array) -> CbfRows:
        """Return rows that ask for a stop where ψ is below zero; those of other states as given."""
        if self._most is None or rows.alpha2_psi is None or not (rows.alpha2_psi < 0.0).any():
            return rows
        b = rows.b.copy()
        late_ones = (rows.alpha2_psi < 0.0) & (prepared.scene.degree[0] == 2)
        for at in map(tuple, np.argwhere(late_ones)):
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
            found = {} if functions is None else dict(zip(own, functions.reaches, strict=True))
            found |= {k: self._reach(b) for k, b in enumerate(key) if k not in found}
            reaches = [found[k] for k in range(len(key))]
            scene = _scene(key, [reach.degree for reach in reaches])
            turns = bool((scene.degree[scene.kind != ELSEWHERE] == 2).any())
            custom = [(int(k), key[k]) for k in np.flatnonzero(scene.kind[0] == layout.CUSTOM)]
            priority = np.array([barrier.priority for barrier in key], dtype=np.int64)
            zero, one = margins(key, 0.0), margins(key, 1.0)
            self._latest = Prepared(
                key, own, functions, custom, scene, reaches, turns, priority, zero, one - zero
            )
        return self._latest

    def _functions(self, barriers: Sequence[Barrier]) -> FunctionRows | SeparateRows | None:
        """Return what makes the rows of functions, if there are any."""
        found = [barrier for barrier in barriers if isinstance(barrier, Function)]
        return self.functions.rows(found) if found else None

    def _from_jets(
        self, prepared: Prepared, x: Array, t: float, reserved: Array, terms: tuple[Array, Array]
    ) -> tuple[CbfRows, Array]:
        """Return the rows and their conditioning; those of functions are left empty."""
        n, m = self.model.n, len(prepared.barriers)
        jets = np.zeros((1, m if prepared.custom else 0, width(n)))
        for k, barrier in prepared.custom:
            pack(_checked(barrier, barrier.jet(x, t), n), jets[0, k])
        jacobian = _NO_JACOBIAN
        if prepared.turns:
            jacobian = finite_array("∂f/∂x", self.model.f_jacobian(x), (n, n))[None]
        f, g = terms
        at = Terms(f[None], g[None], jacobian)
        state = x[None], np.array([t], dtype=np.float64)
        a, out = general_kernels.rows(prepared.scene, jets, state, reserved, at, self._alphas)
        if not np.isfinite(out[H]).all():
            for barrier in prepared.barriers:
                if not isinstance(barrier, Function):
                    _checked(barrier, barrier.jet(x, t), n)
        rows = CbfRows(a[0], out[B, 0], out[H, 0], prepared.priority, out[ALPHA2_PSI, 0])
        return rows, out[CONDITIONING, 0]

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
            getattr(given, "shape", ()) == shape and field.dtype.kind in "fiu"
            for given, field, shape in zip(jet, fields, shapes, strict=False)
        )
    except (TypeError, ValueError):  # nothing to go through, or a ragged list
        fields = []
        fits = False
    if not fits:
        raise InvalidInputError(
            f"{barrier.name}: got the jet {jet!r}, expected a barriers.Jet of real numbers and "
            f"arrays: h, ∇h ({n},), ∇²h ({n}, {n}), ∂h/∂t, ∂∇h/∂t ({n},), ∂²h/∂t²"
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


def _scene(barriers: Sequence[Barrier], degrees: list[int]) -> Scene:
    """Return barriers (m,) as one scene; an input enters the derivatives `degrees` (m,) of them."""
    kind = np.full((1, len(barriers)), ELSEWHERE, dtype=np.int64)
    parameters = np.zeros((1, len(barriers), layout.WIDTH))
    for k, barrier in enumerate(barriers):
        if isinstance(barrier, Shape | SpeedLimit) and type(barrier) in BUILT_IN:
            kind[0, k] = barrier.write(parameters[0, k])
        elif not isinstance(barrier, Function):
            kind[0, k] = layout.CUSTOM
    return Scene(kind, parameters, np.array([degrees], dtype=np.int64).reshape(kind.shape))
