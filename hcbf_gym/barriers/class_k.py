"""Extended class-K functions α: strictly increasing, α(0) = 0, with derivative and inverse.

Each exists once, compiled (core/include/hcbf/class_k.hpp), and reads a function's four numbers.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from hcbf_gym import _core, records
from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, finite_float, shown

LINEAR, LOG = 0.0, 1.0
"""The first of the four numbers says which function it is; the others are its parameters."""


@dataclass(frozen=True)
class ClassK(ABC):
    """A class-K function; there is a linear and a logarithmic one."""

    @abstractmethod
    def scaled(self, factor: float) -> "ClassK":
        """Return ``factor · α``."""

    @abstractmethod
    def stretched(self, factor: float) -> "ClassK":
        """Return ``h ↦ α(factor · h)``."""

    @property
    @abstractmethod
    def hardest_speed(self) -> float:
        """The approach speed s at which ``s α'(α⁻¹(s))`` is largest; inf if it grows with s."""

    @abstractmethod
    def parameters(self) -> Array:
        """Return (4,) the kind and its parameters, as the compiled functions read them."""

    @cached_property
    def _numbers(self) -> Array:
        return self.parameters()

    def __call__(self, h: float) -> float:
        """Return α(h)."""
        return _core.class_k_value(self._numbers, h)

    def values(self, h: Array) -> Array:
        """Return α(h) (m,) of h (m,)."""
        out = np.empty(h.size)
        _core.class_k_values(self._numbers, h, out)
        return out

    def derivative(self, h: float) -> float:
        """Return dα/dh."""
        return _core.class_k_slope(self._numbers, h)

    def inverse(self, value: float) -> float:
        """Return α⁻¹(value)."""
        return _core.class_k_inverse(self._numbers, value)


@dataclass(frozen=True)
class LinearClassK(ClassK):
    """The linear function ``α(h) = gain · h``.

    Args:
        gain: slope [1/s], positive.

    Raises:
        InvalidInputError: if `gain` is not a positive finite number.
    """

    gain: float = 2.0

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "gain", finite_float("gain", self.gain, minimum=0.0, exclusive=True)
        )

    def scaled(self, factor: float) -> "LinearClassK":
        """Return ``factor · α``."""
        return LinearClassK(factor * self.gain)

    def stretched(self, factor: float) -> "LinearClassK":
        """Return ``h ↦ α(factor · h)``."""
        return self.scaled(factor)

    @property
    def hardest_speed(self) -> float:
        """Infinite: ``s α'(α⁻¹(s))`` is gain · s."""
        return np.inf

    def parameters(self) -> Array:
        """Return (4,) the kind and its parameters, as the compiled functions read them."""
        return np.array([LINEAR, self.gain, 0.0, 0.0])


@dataclass(frozen=True)
class LogClassK(ClassK):
    """The paper's logarithmic function, an extended class-K∞ function of slope φ₁φ₂/(φ₂|h|+φ₃).

    ``α(h) = sign(h) φ₁ (log(φ₂|h| + φ₃) − log φ₃)``

    Args:
        phi1: scale [m/s], positive.
        phi2: rate [1/m], positive.
        phi3: offset [-], positive.

    Raises:
        InvalidInputError: if a parameter is not a positive finite number.

    Source: section IV-A of the paper, with its values as defaults.
    """

    phi1: float = 1.0
    phi2: float = 0.5
    phi3: float = 0.1

    def __post_init__(self) -> None:
        for name in ("phi1", "phi2", "phi3"):
            number = finite_float(name, getattr(self, name), minimum=0.0, exclusive=True)
            object.__setattr__(self, name, number)

    def scaled(self, factor: float) -> "LogClassK":
        """Return ``factor · α``."""
        return replace(self, phi1=factor * self.phi1)

    def stretched(self, factor: float) -> "LogClassK":
        """Return ``h ↦ α(factor · h)``."""
        return replace(self, phi2=factor * self.phi2)

    @property
    def hardest_speed(self) -> float:
        """φ₁: ``s α'(α⁻¹(s))`` is ``s φ₁φ₂/φ₃ exp(−s/φ₁)``."""
        return self.phi1

    def parameters(self) -> Array:
        """Return (4,) the kind and its parameters, as the compiled functions read them."""
        return np.array([LOG, self.phi1, self.phi2, self.phi3])


KINDS: dict[str, type] = {"linear": LinearClassK, "log": LogClassK}


def make(alpha: "ClassK | float | dict[str, Any]") -> ClassK:
    """Return the class-K function that `alpha` describes.

    Args:
        alpha: a class-K function, a number (the gain of a linear one [1/s]), or a plain dict
            such as ``{"kind": "log", "phi1": 1.0, "phi2": 0.5, "phi3": 0.1}``.

    Raises:
        InvalidInputError: on anything else.
    """
    if isinstance(alpha, LinearClassK | LogClassK):
        return alpha
    if isinstance(alpha, dict):
        return records.from_dict("class-K function", alpha, KINDS)
    if isinstance(alpha, int | float) and not isinstance(alpha, bool):
        return LinearClassK(alpha)
    raise InvalidInputError(
        f"class-K function: got {shown(alpha)}, expected a gain, a dict or one of {sorted(KINDS)}"
    )
