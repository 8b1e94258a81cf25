"""Reduced-order models ẋ = f(x) + g(x)u: their base classes, and the point-mass models.

The planar models' states start with the position (x, y). A model's f and g take NumPy arrays, and
JAX arrays while `barriers.Function` differentiates through them.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, count, finite_array, finite_float, reals


class ReducedOrderModel(ABC):
    """A control-affine model, ``ẋ = f(x) + g(x)u``.

    Attributes:
        n: the number of states.
        n_u: the number of inputs.
        velocity_at: the index in x at which the planar velocity begins, which speed limits read;
            None if x has no such velocity.

    Source: equation (1) of the paper.
    """

    n: int
    n_u: int
    velocity_at: int | None

    @property
    def n_p(self) -> int:
        """The number of position coordinates, which are the first states."""
        return min(2, self.n)

    @abstractmethod
    def f(self, x: Any) -> Any:
        """Return (n,) the drift."""

    @abstractmethod
    def g(self, x: Any) -> Any:
        """Return (n, n_u) the input matrix."""

    def terms(self, x: Array) -> tuple[Array, Array]:
        """Return f (n,) and g (n, n_u) at x (n,), as compiled code reads them.

        Raises:
            InvalidInputError: if f or g has another shape, or is not made of real numbers.
        """
        f = np.ascontiguousarray(reals("f", self.f(x)))
        g = np.ascontiguousarray(reals("g", self.g(x)))
        if f.shape != (self.n,) or g.shape != (self.n, self.n_u):
            raise InvalidInputError(
                f"{self}: got f of shape {f.shape} and g of shape {g.shape}, expected "
                f"({self.n},) and ({self.n}, {self.n_u})"
            )
        return f, g

    def f_jacobian(self, x: Array) -> Array:
        """Return (n, n) ∂f/∂x, by central differences unless a model overrides this."""
        sizes = 6e-6 * (1.0 + np.abs(x))  # ∛ε: truncation and rounding errors are alike
        steps = np.diag(sizes)
        ahead = np.array([self.f(state) for state in x + steps])
        behind = np.array([self.f(state) for state in x - steps])
        return ((ahead - behind) / (2.0 * sizes)[:, None]).T

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Advance x (n,) by dt [s] under a constant u (n_u,): one Runge–Kutta step, 4th order."""

        def rate(state: Array) -> Array:
            return self.f(state) + self.g(state) @ u

        k1 = rate(x)
        k2 = rate(x + 0.5 * dt * k1)
        k3 = rate(x + 0.5 * dt * k2)
        k4 = rate(x + dt * k3)
        return x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    def brake(self, x: Array, dt: float) -> Array:
        """Return (n_u,) the input that brings the plant to rest within dt [s]: 0 unless it coasts.

        Args:
            x: (n,) state.
            dt: [s].
        """
        return np.zeros(self.n_u)

    def terms_of(self, x: Array) -> tuple[Array, Array]:
        """Return f (N, n) and g (N, n, n_u) at N states x (N, n); see `terms`."""
        terms = [self.terms(state) for state in x]
        return np.array([f for f, _ in terms]), np.array([g for _, g in terms])

    def jacobians_of(self, x: Array) -> Array:
        """Return ∂f/∂x (N, n, n) at N states x (N, n).

        Raises:
            InvalidInputError: if they are no finite real numbers, or have another shape.
        """
        jacobians = np.array([reals("∂f/∂x", self.f_jacobian(state)) for state in x])
        return finite_array("∂f/∂x", jacobians, (len(x), self.n, self.n))

    def steps_of(self, x: Array, u: Array, dt: float) -> Array:
        """Advance N states x (N, n) by dt [s] under constant inputs u (N, n_u)."""
        pairs = zip(x, u, strict=True)
        return np.array([reals("step", self.step(state, held, dt)) for state, held in pairs])

    def brakes_of(self, x: Array, dt: float) -> Array:
        """Return (N, n_u) the inputs that bring N states x (N, n) to rest; see `brake`."""
        if type(self).brake is ReducedOrderModel.brake:
            return np.zeros((len(x), self.n_u))
        return np.array([reals("brake", self.brake(state, dt)) for state in x])


class BuiltIn(ReducedOrderModel):
    """A model that the core evaluates; the methods of a user's subclass evaluate that."""

    @abstractmethod
    def _make_core(self) -> _core.Model:
        """Return the core's object of the model."""

    @abstractmethod
    def _traced(self, x: Any) -> tuple[Any, Any]:
        """Return f and g of a JAX array that is traced."""

    @cached_property
    def core(self) -> _core.Model:
        """The core's object of the model, which is made when it is first used."""
        return self._make_core()

    @property
    def is_own(self) -> bool:
        """Whether the class itself is built in, not a user's subclass of one."""
        return BuiltIn in type(self).__bases__

    def __getstate__(self) -> dict[str, object]:
        """Return the fields alone: compiled objects are not copied."""
        return {name: value for name, value in vars(self).items() if name != "core"}

    def f(self, x: Any) -> Any:
        """Return (n,) the drift."""
        return self.core.terms(x[None])[0][0] if type(x) is np.ndarray else self._traced(x)[0]

    def g(self, x: Any) -> Any:
        """Return (n, n_u) the input matrix."""
        return self.core.terms(x[None])[1][0] if type(x) is np.ndarray else self._traced(x)[1]

    def f_jacobian(self, x: Array) -> Array:
        """Return (n, n) ∂f/∂x."""
        return self.core.jacobians(x[None])[0]

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Advance x (n,) by dt [s] under a constant u (n_u,)."""
        return self.steps_of(x[None], u[None], dt)[0] if self.is_own else super().step(x, u, dt)

    def brake(self, x: Array, dt: float) -> Array:
        """Return (n_u,) the input that brings the plant to rest within dt [s]."""
        return self.core.brakes(x[None], dt)[0]

    def terms_of(self, x: Array) -> tuple[Array, Array]:
        """Return f (N, n) and g (N, n, n_u) at N states x (N, n)."""
        return self.core.terms(x) if self.is_own else super().terms_of(x)

    def jacobians_of(self, x: Array) -> Array:
        """Return ∂f/∂x (N, n, n) at N states x (N, n)."""
        return self.core.jacobians(x) if self.is_own else super().jacobians_of(x)

    def steps_of(self, x: Array, u: Array, dt: float) -> Array:
        """Advance N states x (N, n) by dt [s] under constant inputs u (N, n_u)."""
        return self.core.steps(x, u, dt) if self.is_own else super().steps_of(x, u, dt)

    def brakes_of(self, x: Array, dt: float) -> Array:
        """Return (N, n_u) the inputs that bring N states x (N, n) to rest."""
        return self.core.brakes(x, dt) if self.is_own else super().brakes_of(x, dt)


def namespace(x: Any) -> Any:
    """Return the module whose functions fit the array x: NumPy or jax.numpy."""
    return x.__array_namespace__()


@dataclass(frozen=True)
class SingleIntegrator(BuiltIn):
    """A point whose velocity is the input, ``ẋ = u``; an arm driven by joint velocities.

    Args:
        n_u: the number of states and of inputs; x and u are (n_u,).

    Raises:
        InvalidInputError: if `n_u` is not a positive integer.
    """

    n_u: int = 2
    n: int = field(init=False, repr=False)
    velocity_at: int | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        object.__setattr__(self, "n", count("n_u", self.n_u))

    @property
    def n_p(self) -> int:
        """The number of position coordinates: all states."""
        return self.n

    def _make_core(self) -> _core.Model:
        return _core.SingleIntegrator(self.n)

    def _traced(self, x: Any) -> tuple[Any, Any]:
        return 0.0 * x, namespace(x).eye(self.n)


@dataclass(frozen=True)
class DoubleIntegrator(BuiltIn):
    """A point whose acceleration is the input, ``p̈ = u − c ṗ``: x = (p, v), u [m/s²].

    Args:
        n_u: the number of inputs; x is (2 n_u,).
        drag: c [1/s], at least 0.

    Raises:
        InvalidInputError: if `n_u` is not a positive integer or the drag is negative.

    Source: section IV-A of the paper, without drag.
    """

    n_u: int = 2
    drag: float = 0.0
    n: int = field(init=False, repr=False)
    velocity_at: int | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "n", 2 * count("n_u", self.n_u))
        object.__setattr__(self, "drag", finite_float("drag", self.drag, minimum=0.0))
        object.__setattr__(self, "velocity_at", 2 if self.n_u == 2 else None)

    @property
    def n_p(self) -> int:
        """The number of position coordinates, which are the first states."""
        return self.n_u

    def _make_core(self) -> _core.Model:
        return _core.DoubleIntegrator(self.n_u, self.drag)

    def _traced(self, x: Any) -> tuple[Any, Any]:
        xp, velocity = namespace(x), x[self.n_u :]
        inputs = xp.eye(self.n, self.n_u, k=-self.n_u)
        return xp.concatenate([velocity, -self.drag * velocity]), inputs
