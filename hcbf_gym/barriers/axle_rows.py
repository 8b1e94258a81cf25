r"""Rows of a differential drive: regions at rest bind its axle, all others the point before it.

A row ``n·p̈ ≥ b`` on the axle is one in the point's acceleration u (`models.axle`), linear because
the axle's is,

.. math::
    \big((n·ê) e + (T v/ℓ) (n·ê_⊥) e_⊥\big)·u ≥ b - v\, n·(ê - e)/T,

with ê the heading after one period at the present turning rate. `docs/rows.md` proves when braking
along the heading meets them all.
"""

from dataclasses import replace

import numpy as np

from hcbf_gym import _core
from hcbf_gym.barriers.braking import PLACES, greatest
from hcbf_gym.barriers.rows import RowSettings
from hcbf_gym.models.axle import Axle

USED = 0.85
"""Share of the braking along the heading that a single row may request."""


def share(settings: RowSettings, axle: Axle) -> float:
    """Return the greatest c ≤ 1 with which braking along the heading meets every row of α₁(c h).

    On ψ = 0 the robot nears a wall at the speed s = v cos φ and the row requests b(s), to which
    braking along the heading gives A cos φ. With ``v ≤ V`` that is enough at every angle where
    ``(b(s) − b(0)) V/s ≤ 0.85 A`` for all s ≤ V. b(0) is reserved as a length, see `at_a_glance`.
    The slope of α₁ counts, at all speeds alike; so distances are stretched, and α₁ is not scaled.

    Args:
        settings: α₁, α₂ and the hold, with the axle's greatest acceleration.
        axle: what limits the drive.
    """

    def fits(c: float) -> bool:
        alpha1 = settings.alpha1 if c == 1.0 else settings.alpha1.stretched(c)
        scaled = replace(settings, alpha1=alpha1)
        at_rest, most = _bound(scaled, 0.0, 0.0), 0.0
        for speed in np.linspace(0.0, axle.forward, PLACES + 1)[1:].tolist():
            b = _bound(scaled, alpha1.inverse(speed), speed)
            most = max(most, (b - at_rest) * axle.forward / speed)
        return most <= USED * axle.braking

    return greatest(fits)


def at_a_glance(settings: RowSettings, jerk: float) -> float:
    """Return the least h − m at which a row requests nothing where the wall is not neared [m].

    Args:
        settings: α₁, α₂ and the hold.
        jerk: what the row reserves of the acceleration, `Axle.jerk` [m/s²].
    """
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _bound(settings, middle, 0.0) + jerk <= 0.0:
            high = middle
        else:
            low = middle
    return high


def _bound(settings: RowSettings, kept: float, speed: float) -> float:
    """Return b of the row beside a wall that is `kept` away and neared at a speed."""
    if settings.held:
        return _core.held_row(kept, -speed, 0.0, speed, 0.0, np.inf, settings.packed)[0]
    psi = settings.alpha1.values(np.array([kept]))[0] - speed
    return settings.alpha1.derivative(kept) * speed - settings.alpha2.values(np.array([psi]))[0]
