"""Extended class-K functions α: strictly increasing, α(0) = 0, with derivative and inverse."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hcbf_gym import records
from hcbf_gym.errors import InvalidInputError, finite_float


class ClassK(Protocol):
    """What a barrier condition needs of α."""

    def __call__(self, h: float) -> float:
        """Return α(h)."""
        ...

    def derivative(self, h: float) -> float:
        """Return dα/dh."""
        ...

    def inverse(self, value: float) -> float:
        """Return α⁻¹(value)."""
        ...

    def parameters(self) -> NDArray[np.float64]:
        """Return (4,) the kind and its parameters, as the compiled kernels read them."""
        ...


@dataclass(frozen=True)
class LinearClassK:
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

    def __call__(self, h: float) -> float:
        """Return α(h)."""
        return self.gain * h

    def derivative(self, h: float) -> float:
        """Return dα/dh."""
        return self.gain

    def inverse(self, value: float) -> float:
        """Return α⁻¹(value)."""
        return value / self.gain

    def parameters(self) -> NDArray[np.float64]:
        """Return (4,) the kind and its parameters, as the compiled kernels read them."""
        return np.array([0.0, self.gain, 0.0, 0.0])


@dataclass(frozen=True)
class LogClassK:
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
            value = finite_float(name, getattr(self, name), minimum=0.0, exclusive=True)
            object.__setattr__(self, name, value)

    def __call__(self, h: float) -> float:
        """Return α(h)."""
        return float(np.sign(h) * self.phi1 * np.log1p(self.phi2 * abs(h) / self.phi3))

    def derivative(self, h: float) -> float:
        """Return dα/dh."""
        return self.phi1 * self.phi2 / (self.phi2 * abs(h) + self.phi3)

    def inverse(self, value: float) -> float:
        """Return α⁻¹(value)."""
        return float(np.sign(value) * self.phi3 / self.phi2 * np.expm1(abs(value) / self.phi1))

    def parameters(self) -> NDArray[np.float64]:
        """Return (4,) the kind and its parameters, as the compiled kernels read them."""
        return np.array([1.0, self.phi1, self.phi2, self.phi3])


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
        f"class-K function: got {alpha!r}, expected a gain, a dict or one of {sorted(KINDS)}"
    )
