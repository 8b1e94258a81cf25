"""The filters that are compared, each by its name."""

import importlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.ground_truth.truths import PERIOD, REACH, Truth
from hcbf_gym import BatchFilter
from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import Barrier
from hcbf_gym.filter.settings import ROW_OPTIONS
from hcbf_gym.models.input_sets import Box

BRAKE = {"kind": "brake", "deceleration": 0.9 * REACH, "offset": 0.9 * REACH * PERIOD}
"""α₁ for `BrakeClassK`, as steep as a held input permits."""


def _gains(gain: float) -> dict[str, Any]:
    """Return α₂, and that of speed limits."""
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
"""And other programs, which answer as the first does where there is one condition."""
PEERS = {"cbfpy, gains 1": 1.0, "cbfpy, gains 5": 5.0}
LEAST = "least restrictive"

Step = Callable[[Array, Array], tuple[Array, Mask]]
"""Of a filter of N plants: states, inputs → the inputs that it applies, which states it accepts."""


def begin(name: str, conditions: Sequence[Barrier], x: Array, truth: Truth | None = None) -> Step:
    """Return a filter whose N plants begin at states (N, 4)."""
    if name in PEERS:
        return _cbfpy(conditions, PEERS[name])
    if truth is not None and name == LEAST:
        return lambda x, u: _least_restrictive(truth, x, u)
    options = RANKED[name]
    made = BatchFilter(Box.symmetric(REACH), PERIOD, num_envs=len(x), **options)
    made.set_scene(conditions)
    made.reset(x=x)

    def step(x: Array, u: Array) -> tuple[Array, Mask]:
        applied, report = made(u, x)
        accepts = ((report["h"] >= report["margin"]) & (report["psi"] >= 0.0)).all(axis=1)
        if "strict" in options:
            accepts = report["reason"] != Reason["UNVERIFIED"]
        return np.clip(applied, -REACH, REACH), accepts

    return step


def _cbfpy(conditions: Sequence[Barrier], gain: float) -> Step:
    peers: Any = importlib.import_module("benchmarks.peers")
    of_many, psi_of = peers.cbfpy_batch(tuple(conditions), gain)

    def step(x: Array, u: Array) -> tuple[Array, Mask]:
        h, psi = psi_of(x)
        return np.clip(of_many(x, u), -REACH, REACH), ((h >= 0.0) & (psi >= 0.0)).all(axis=1)

    return step


def _least_restrictive(truth: Truth, x: Array, u: Array) -> tuple[Array, Mask]:
    """Return u where the kernel permits it, else the kernel's best input; it accepts its states."""
    changes, applied = ~truth.permits(x, u), u.copy()
    applied[changes] = truth.best(x[changes])
    return applied, np.ones(len(x), dtype=np.bool_)
