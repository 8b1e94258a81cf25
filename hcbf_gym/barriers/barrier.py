"""What a barrier is: a ranked safety condition h(x, t) ≥ 0 with its derivatives.

A user's own barrier is a frozen dataclass. It is a subclass of `Barrier` with a `jet`, or, if h
depends on the position alone, of `PlanarBarrier` with a `planar_jet`.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.layout import LOWEST_RANK
from hcbf_gym.errors import InvalidInputError, finite_array, reals, shown


class Jet(NamedTuple):
    """A barrier and its derivatives at one state and time.

    Attributes:
        h: value [m], or [m/s] for a speed limit.
        gradient: (n,) ∂h/∂x.
        hessian: (n, n) ∂²h/∂x².
        rate: ∂h/∂t.
        gradient_rate: (n,) ∂²h/∂x∂t.
        rate_rate: ∂²h/∂t².
    """

    h: float
    gradient: Array
    hessian: Array
    rate: float
    gradient_rate: Array
    rate_rate: float


def packed_size(n: int) -> int:
    """Return how many numbers `pack` writes for a jet of n states."""
    return 3 + 2 * n + n * n


def pack(jet: Jet, packed: Array) -> None:
    """Write a jet as compiled code reads it: h, ∂h/∂t, ∂²h/∂t², ∇h, ∂∇h/∂t and ∇²h by rows.

    Args:
        jet: h and its derivatives at n states.
        packed: (`packed_size(n)`,) the numbers that are written.
    """
    n = len(jet.gradient)
    packed[:3] = jet.h, jet.rate, jet.rate_rate
    packed[3 : 3 + n] = jet.gradient
    packed[3 + n : 3 + 2 * n] = jet.gradient_rate
    packed[3 + 2 * n :] = np.ravel(jet.hessian)


class Core(NamedTuple):
    """The convex set from which a barrier is a distance near a position: ``h = distance − radius``.

    The core of a disc is its centre. That of a convex polygon is the polygon, or one of its corners
    where no other part can become the nearest.

    Attributes:
        distance: the distance from the core [m]; infinite where ∇H does not turn within the reach.
        radius: how far the region extends beyond its core [m].
        is_point: whether the core is a point everywhere within the reach.
    """

    distance: float
    radius: float
    is_point: bool


def checked(
    barrier: "Barrier", jet: Any, n: int, finite: bool = True, count: int | None = None
) -> Jet:
    """Return what a user's own barrier returned as a jet of n states, if it is one.

    Args:
        barrier: the barrier, whose name is in messages.
        jet: what its `jet` returned, or its `batch`.
        n: the number of states.
        finite: whether all entries have to be finite.
        count: N of a batch, whose fields have a leading N; None for one jet.

    Raises:
        InvalidInputError: if it is no jet of real numbers, or an entry is not finite.
    """
    if count is None and isinstance(jet, Jet) and is_plain(jet, n):
        return jet
    many = () if count is None else (count,)
    shapes = many, (*many, n), (*many, n, n), many, (*many, n), many
    fields = real_parts(jet, shapes)
    if fields is None:
        leading = "" if count is None else f" {count} times"
        raise InvalidInputError(
            f"{barrier.name}: got the jet {shown(jet)}, expected a barriers.Jet of real numbers "
            f"and arrays{leading}: h, ∇h ({n},), ∇²h ({n}, {n}), ∂h/∂t, ∂∇h/∂t ({n},), ∂²h/∂t²"
        )
    if finite and not all(np.isfinite(field).all() for field in fields):
        raise InvalidInputError(
            f"{barrier.name}: got the jet {shown(jet)}, expected finite numbers"
        )
    return Jet._make(fields)


def real_parts(parts: Any, shapes: tuple[tuple[int, ...], ...]) -> list[Any] | None:
    """Return real numbers and arrays of the shapes; None if a user's code returned other parts.

    Numbers become floats. Lists are refused in the place of arrays.
    """
    try:
        given = list(parts)
        arrays = [reals("part", part) for part in given]
        is_array = [not isinstance(part, list | tuple) for part in given]
    except Exception:  # not iterable, no real numbers, or a user's object that raises anything
        return None
    if not all(is_array) or tuple(array.shape for array in arrays) != shapes:
        return None
    return [array if array.ndim else float(array) for array in arrays]


def is_plain(jet: Jet, n: int) -> bool:
    """Return in microseconds whether a jet surely has finite floats; `checked` decides the rest."""
    h, gradient, hessian, rate, gradient_rate, rate_rate = jet
    arrays = gradient, hessian, gradient_rate
    if not all(type(field) is np.ndarray and field.dtype == np.float64 for field in arrays):
        return False
    if not all(isinstance(field, float) for field in (h, rate, rate_rate)):
        return False
    if gradient.shape != (n,) or hessian.shape != (n, n) or gradient_rate.shape != (n,):
        return False
    total = np.vdot(gradient, gradient) + np.vdot(hessian, hessian)
    total += np.vdot(gradient_rate, gradient_rate)
    return math.isfinite(total + abs(h) + abs(rate) + abs(rate_rate))


def check_name(name: object, priority: object) -> None:
    """Refuse a name that is no text, or a priority that is no rank.

    Raises:
        InvalidInputError: if the name is empty or the priority no integer from 1 to `LOWEST_RANK`.
    """
    if not isinstance(name, str) or not name:
        raise InvalidInputError(f"barrier name: got {shown(name)}, expected non-empty text")
    if isinstance(priority, bool) or not isinstance(priority, int | np.integer):
        raise InvalidInputError(f"{name}: priority: got {shown(priority)}, expected int")
    if not 1 <= priority <= LOWEST_RANK:
        raise InvalidInputError(
            f"{name}: priority: got {priority}, expected >= 1 and <= {LOWEST_RANK}"
        )


def is_newer(cls: type, name: str, than: str) -> bool:
    """Return whether a class has both attributes, and the first from a class derived later."""
    having = [{name, than} & vars(base).keys() for base in cls.__mro__]
    return hasattr(cls, than) and next(filter(None, having), None) == {name}


@dataclass(frozen=True)
class Barrier(ABC):
    """A named, ranked safety condition ``h(x, t) ≥ 0``.

    Args:
        name: what tables and figures call it.
        priority: 1 is the highest and strict; larger numbers are relaxed first.

    Raises:
        InvalidInputError: if the name is empty or the priority is not a positive integer.
    """

    name: str
    priority: int
    reads_position: ClassVar[bool] = True

    def __init_subclass__(cls, **arguments: Any) -> None:
        """Take from a class with another h the `batch` and the `core` that it has inherited."""
        super().__init_subclass__(**arguments)
        for name in ("batch", "core"):
            if any(is_newer(cls, source, than=name) for source in ("jet", "planar_jet")):
                default = Barrier if name == "batch" else PlanarBarrier
                setattr(cls, name, getattr(default, name))

    def __post_init__(self) -> None:
        check_name(self.name, self.priority)

    @abstractmethod
    def jet(self, x: Array, t: float = 0.0) -> Jet:
        """Return h and its derivatives.

        Args:
            x: (n,) state of the reduced-order model, position first.
            t: time [s].
        """

    def h(self, x: Array, t: float = 0.0) -> float:
        """Return the barrier's value at the state x (n,) and time t [s]."""
        return self.jet(x, t).h

    def moved(self, step: Array) -> "Barrier":
        """Return the condition moved by a step (2,) [m], whose h at x is this h at x − step."""
        if not self.reads_position:
            return self
        return Elsewhere(self.name, self.priority, self, np.array(step))

    def batch(self, x: Array, t: Array) -> Jet:
        """Return h and its derivatives at N states x (N, n) and times t (N,), with a leading N.

        The default calls `jet` N times; a subclass may compute all jets at once.
        """
        jets = [
            checked(self, self.jet(state, float(time)), len(state), finite=False)
            for state, time in zip(x, t, strict=True)
        ]
        return Jet._make(np.array(field) for field in zip(*jets, strict=True))


@dataclass(frozen=True)
class PlanarBarrier(Barrier):
    """A condition on the position alone, in a frame that may move at constant velocity.

    ``h(x, t) = H(q)`` with ``q = p − w t``, so that ∂h/∂t = −∇H·w. Rows read `planar_jet`, or the
    `jet` of a class that overrides it.
    """

    @property
    def frame_velocity(self) -> Array:
        """(2,) the velocity w of the barrier's frame [m/s]."""
        return np.asarray(getattr(self, "velocity", (0.0, 0.0)))

    @abstractmethod
    def planar_jet(self, q: Array) -> tuple[float, Array, Array]:
        """Return H, ∇H (2,) and ∇²H (2, 2) at the position q (2,) in the barrier's frame."""

    def moved(self, step: Array) -> Barrier:
        """Return the same condition a step (2,) [m] away."""
        if not reads_planar_jet(type(self)):
            return super().moved(step)
        return PlanarElsewhere(self.name, self.priority, self, np.array(step))

    def core(self, q: Array, reach: float) -> Core | None:
        """Return the core of a convex region around which ∇H turns, or None if that is unknown.

        Rows for a held input need it; without it a barrier has its usual row.

        Args:
            q: (2,) position in the barrier's frame [m].
            reach: how far the robot gets in one period [m].
        """
        return None

    def jet(self, x: Array, t: float = 0.0) -> Jet:
        """Return h and its derivatives."""
        w = velocity_of(self)
        value, planar_gradient, planar_hessian = planar_jet_of(self, x[:2] - w * t)
        gradient, gradient_rate = np.zeros((2, len(x)))
        hessian = np.zeros((len(x), len(x)))
        gradient[:2] = planar_gradient
        hessian[:2, :2] = planar_hessian
        gradient_rate[:2] = -planar_hessian @ w
        return Jet(
            h=value,
            gradient=gradient,
            hessian=hessian,
            rate=float(-planar_gradient @ w),
            gradient_rate=gradient_rate,
            rate_rate=float(w @ planar_hessian @ w),
        )


def reads_planar_jet(cls: type[Barrier]) -> bool:
    """Return whether rows read the `planar_jet` of a class, as it has no `jet` of its own."""
    return issubclass(cls, PlanarBarrier) and cls.jet is PlanarBarrier.jet


def velocity_of(barrier: PlanarBarrier) -> Array:
    """Return (2,) the velocity of a barrier's frame [m/s].

    Raises:
        InvalidInputError: if a user's own is not made of two finite real numbers.
    """
    w = barrier.frame_velocity
    is_plain_pair = type(w) is np.ndarray and w.dtype == np.float64 and w.shape == (2,)
    if is_plain_pair and math.isfinite(w[0] + w[1]):
        return w
    return finite_array(f"{barrier.name}: frame_velocity", w, (2,))


def planar_jet_of(barrier: PlanarBarrier, q: Array) -> tuple[float, Array, Array]:
    """Return H, ∇H (2,) and ∇²H (2, 2) of a barrier at the position q (2,) in its frame.

    Raises:
        InvalidInputError: if a user's own returns anything but real numbers, or other shapes.
    """
    answer = barrier.planar_jet(q)
    if type(answer) is tuple and len(answer) == 3:
        h, gradient, hessian = answer
        arrays_are_plain = all(
            type(array) is np.ndarray and array.dtype == np.float64 and array.shape == shape
            for array, shape in ((gradient, (2,)), (hessian, (2, 2)))
        )
        if arrays_are_plain and isinstance(h, float):
            return float(h), gradient, hessian
    parts = real_parts(answer, ((), (2,), (2, 2)))
    if parts is None:
        raise InvalidInputError(
            f"{barrier.name}: got the planar jet {shown(answer)}, expected real numbers and "
            "arrays: H, ∇H (2,), ∇²H (2, 2)"
        )
    h, gradient, hessian = parts
    return h, gradient, hessian


@dataclass(frozen=True, eq=False)
class Elsewhere(Barrier):
    """Another condition, `original`, moved by a step (2,) [m]."""

    original: Barrier
    step: Array

    def jet(self, x: Array, t: float = 0.0) -> Jet:
        """Return h and its derivatives."""
        return self.original.jet(self._moved_back(x), t)

    def batch(self, x: Array, t: Array) -> Jet:
        """Return h and its derivatives at many states."""
        return self.original.batch(self._moved_back(x), t)

    def _moved_back(self, x: Array) -> Array:
        """Return states (…, n) whose positions are moved by −step."""
        states = np.array(x)
        states[..., :2] -= self.step
        return states


@dataclass(frozen=True, eq=False)
class PlanarElsewhere(PlanarBarrier):
    """Another condition on the position, moved; see `Elsewhere`."""

    original: PlanarBarrier
    step: Array

    @property
    def frame_velocity(self) -> Array:
        """(2,) the velocity of the original's frame [m/s]."""
        return self.original.frame_velocity

    def planar_jet(self, q: Array) -> tuple[float, Array, Array]:
        """Return H, ∇H and ∇²H at a position q (2,)."""
        return self.original.planar_jet(q - self.step)

    def core(self, q: Array, reach: float) -> Core | None:
        """Return the core; see `PlanarBarrier.core`."""
        return self.original.core(q - self.step, reach)


def reads_time(barrier: Barrier, n: int) -> bool:
    """Return whether h of n states changes with time, at eight sampled states and three times."""
    states = np.random.default_rng(0).normal(size=(8, n))
    values = np.array([[barrier.h(x, t) for t in (0.0, 0.7, 31.0)] for x in states])
    at_time_0 = np.broadcast_to(values[:, :1], values.shape)
    return not np.array_equal(values, at_time_0, equal_nan=True)
