"""The filters that are compared, each by its name: from conditions and N to a `Filter`."""

import importlib
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from benchmarks.ground_truth.truths import PERIOD, REACH, Truth
from hcbf_gym import BatchFilter
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import Barrier
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.filter.settings import ROW_OPTIONS
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.plant import Reason

BRAKE = {"kind": "brake", "deceleration": 0.9 * REACH, "offset": 0.9 * REACH * PERIOD}
"""α₁ for `BrakeClassK`, of the steepest slope that a held input permits."""


def _gains(gain: float) -> dict[str, Any]:
    """Return α₂ and that of the speed limit."""
    return {name: gain for name in ROW_OPTIONS if name != "alpha1"}


OURS: dict[str, dict[str, Any]] = {  # name → options of `BatchFilter`
    "held rows, α₂ = 2": _gains(2.0),
    "held rows, α₂ = 10": _gains(10.0),
    "usual rows, α₂ = 2": {"rows": "usual", **_gains(2.0)},
    "usual rows, α₂ = 10": {"rows": "usual", **_gains(10.0)},
    "held rows, BrakeClassK": {"alpha1": BRAKE, **_gains(0.5 / PERIOD)},
    "gatekeeper": {"strict": "gatekeeper"},
}
RANKED = OURS | {
    name: {"program": program, **_gains(10.0)}
    for name, program in (("R", "r-cbf-qp"), ("EH", "eh-cbf-qp"), ("no ranks", "cbf-qp"))
}
"""Besides, other programs, which are the same as the first where there is one condition."""
PEERS = {"cbfpy, gains 1": 1.0, "cbfpy, gains 5": 5.0}
LEAST = "least restrictive"


class Filter(Protocol):
    """A filter of N double integrators."""

    def reset(self, x: Array) -> None:
        """Begin at states (N, 4)."""

    def __call__(self, x: Array, u: Array) -> Array:
        """Return the inputs (N, 2) that it applies instead of u (N, 2)."""
        ...

    def accepts(self, x: Array) -> Mask:
        """Return (N,) whether it counted the states of the last call as safe."""
        ...


class Ours:
    """A `BatchFilter`."""

    def __init__(self, conditions: Sequence[Barrier], n: int, options: dict[str, Any]):
        self._filter = BatchFilter(Box.symmetric(REACH), PERIOD, num_envs=n, **options)
        self._filter.set_scene(conditions)
        self._verifies = "strict" in options

    def reset(self, x: Array) -> None:
        self._filter.reset(x=x)

    def __call__(self, x: Array, u: Array) -> Array:
        applied, self._report = self._filter(u, x)
        return np.clip(applied, -REACH, REACH)

    def accepts(self, x: Array) -> Mask:
        report = self._report
        if self._verifies:
            return report["reason"] != Reason["UNVERIFIED"]
        return ((report["h"] >= report["margin"]) & (report["psi"] >= 0.0)).all(axis=1)


class Cbfpy:
    """cbfpy with ElastiQP, both its gains the same."""

    def __init__(self, conditions: Sequence[Barrier], gain: float):
        peers: Any = importlib.import_module("benchmarks.peers")
        self._of_many, self._psi = peers.cbfpy_batch(conditions, gain)

    def reset(self, x: Array) -> None:
        pass

    def __call__(self, x: Array, u: Array) -> Array:
        return np.clip(self._of_many(x, u), -REACH, REACH)

    def accepts(self, x: Array) -> Mask:
        h, psi = self._psi(x)
        return ((h >= 0.0) & (psi >= 0.0)).all(axis=1)


class LeastRestrictive:
    """u where the kernel permits it, else the input that is best by the kernel."""

    def __init__(self, truth: Truth):
        self._truth = truth

    def reset(self, x: Array) -> None:
        pass

    def __call__(self, x: Array, u: Array) -> Array:
        changes, applied = ~self._truth.is_safe(x, u), u.copy()
        applied[changes] = self._truth.best(x[changes])
        return applied

    def accepts(self, x: Array) -> Mask:
        return self._truth.value(x) >= 0.0


def by_name(
    name: str, conditions: Sequence[Barrier], truth: Truth | None = None
) -> Callable[[int], Filter]:
    """Return what makes a filter of N plants."""
    if name in PEERS:
        return lambda n: Cbfpy(conditions, PEERS[name])
    if name == LEAST and truth is not None:
        return lambda n: LeastRestrictive(truth)
    return lambda n: Ours(conditions, n, RANKED[name])


def exists(options: dict[str, Any]) -> bool:
    """Return whether this version takes the options of a filter."""
    try:
        BatchFilter(Box.symmetric(REACH), PERIOD, **options)
    except (InvalidInputError, UnknownNameError):
        return False
    return True
