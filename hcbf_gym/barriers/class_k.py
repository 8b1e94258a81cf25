"""Extended class-K functions α: strictly increasing, α(0) = 0, evaluated by the core."""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from hcbf_gym import _core, records
from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, check_not_overridden, finite_float, shown


@dataclass(frozen=True)
class ClassK:
    """A class-K function of positive parameters; `KINDS` lists its subclasses."""

    code: ClassVar[float]  # by which the core recognises the function
    scale: ClassVar[str]  # the name of the parameter that multiplies α
    rate: ClassVar[str]  # the name of the parameter that multiplies h

    def __post_init__(self) -> None:
        for field in fields(self):
            value = finite_float(field.name, getattr(self, field.name), minimum=0.0, exclusive=True)
            object.__setattr__(self, field.name, value)

    def scaled(self, factor: float) -> Self:
        """Return ``factor · α``."""
        return replace(self, **{self.scale: factor * getattr(self, self.scale)})

    def stretched(self, factor: float) -> Self:
        """Return ``h ↦ α(factor · h)``."""
        return replace(self, **{self.rate: factor * getattr(self, self.rate)})

    @property
    def hardest_speed(self) -> float:
        """The approach speed s at which ``s α'(α⁻¹(s))`` is largest; inf if it grows with s."""
        return np.inf

    def parameters(self) -> Array:
        """Return (4,) the code and up to three parameters, as the core reads them."""
        parameters = [getattr(self, field.name) for field in fields(self)]
        return np.array([self.code, *parameters, 0.0, 0.0])[:4]

    @cached_property
    def _numbers(self) -> Array:
        return self.parameters()

    def __call__(self, h: float) -> float:
        """Return α(h)."""
        return _core.class_k_value(self._numbers, h)

    def values(self, h: Array) -> Array:
        """Return α(h) (m,) for h (m,)."""
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

    gain: float
    code: ClassVar[float] = 0.0
    scale: ClassVar[str] = "gain"
    rate: ClassVar[str] = "gain"


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
    code: ClassVar[float] = 1.0
    scale: ClassVar[str] = "phi1"
    rate: ClassVar[str] = "phi2"

    @property
    def hardest_speed(self) -> float:
        """φ₁: ``s α'(α⁻¹(s))`` is ``s φ₁φ₂/φ₃ exp(−s/φ₁)``."""
        return self.phi1


@dataclass(frozen=True)
class BrakeClassK(ClassK):
    """An α₁ close to what U can do: the approach speed from which a deceleration a stops within h.

    ``α(h) = sign(h) (√(2a|h| + c²) − c)``, with the slope ``a / √(2a|h| + c²)``

    It spends the distance that the logarithm leaves for inputs that act later than declared.

    Args:
        deceleration: a [m/s²], positive; a filter lowers it to nine tenths of what U can do.
        offset: c [m/s], positive; ``a/c ≤ 1/T`` where an input is held for T.

    Raises:
        InvalidInputError: if a parameter is not a positive finite number.
    """

    deceleration: float
    offset: float
    code: ClassVar[float] = 2.0
    rate: ClassVar[str] = "deceleration"

    def scaled(self, factor: float) -> Self:
        """Return ``factor · α``, which has the parameters ``factor² a`` and ``factor c``."""
        return replace(
            self, deceleration=factor**2 * self.deceleration, offset=factor * self.offset
        )

    @property
    def hardest_speed(self) -> float:
        """250 c, where ``s α'(α⁻¹(s)) = a s/(s + c)`` is within 0.4 % of a, its supremum."""
        return 250.0 * self.offset

    def parameters(self) -> Array:
        """Return (4,) the code, a, 0 and c, as the core reads them."""
        return np.array([self.code, self.deceleration, 0.0, self.offset])


KINDS: dict[str, type] = {"linear": LinearClassK, "log": LogClassK, "brake": BrakeClassK}
GAIN: float = _core.GAIN
"""The gain of α₂ and of speed limits [1/s], if the robot moves as its model; else `Plant.gain`."""


def unless_given(period: float | None, gain: float = GAIN) -> LinearClassK:
    """Return α₂, and α of speed limits, unless the user gives them: ``min(gain, 0.5/T) · ψ``.

    Args:
        period: T [s]; None takes the longest period that rows allow.
        gain: the plant's gain [1/s].
    """
    return LinearClassK(_core.class_k_gain_at(period or _core.LONGEST_HOLD, gain))


def make(alpha: "ClassK | float | dict[str, Any]") -> ClassK:
    """Return the class-K function that `alpha` describes.

    Args:
        alpha: a class-K function, a number (the gain of a linear one [1/s]), or a plain dict
            such as ``{"kind": "log", "phi1": 1.0, "phi2": 0.5, "phi3": 0.1}``.

    Raises:
        InvalidInputError: on anything else.
    """
    if isinstance(alpha, LinearClassK | LogClassK | BrakeClassK):
        check_not_overridden("class-K function", alpha, LinearClassK, LogClassK, BrakeClassK)
        return alpha
    if isinstance(alpha, dict):
        return records.from_dict("class-K function", alpha, KINDS)
    if isinstance(alpha, int | float) and not isinstance(alpha, bool):
        return LinearClassK(alpha)
    raise InvalidInputError(
        f"class-K function: got {shown(alpha)}, expected a gain, a dict or one of {sorted(KINDS)}"
    )
