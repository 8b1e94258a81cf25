r"""Rows of a differential drive: regions at rest bind its axle, all others the point before it.

A row ``n·p̈ ≥ b`` on the axle becomes a row in the acceleration u of the point (see `models.axle`).
It is linear in u, because the axle's acceleration is:

.. math::
    \big((n·ê) e + (T v/ℓ) (n·ê_⊥) e_⊥\big)·u ≥ b - v\, n·(ê - e)/T,

with ê the heading after one period at the present turning rate. `docs/rows.md` proves when braking
along the heading meets all rows.
"""

from dataclasses import replace

import numpy as np

from hcbf_gym import _core
from hcbf_gym.barriers.braking import SPEED_SAMPLES, greatest_share
from hcbf_gym.barriers.rows import RowSettings
from hcbf_gym.models.axle import Axle

_USED = 0.85  # the share of the braking along the heading that a single row may request


def share(settings: RowSettings, axle: Axle) -> float:
    """Return the greatest c ≤ 1 with which braking along the heading meets every row of α₁(c h).

    On ψ = 0 the robot nears a wall at the speed s = v cos φ and the row requests b(s), to which
    braking along the heading gives A cos φ. With ``v ≤ V`` that is enough at every angle where
    ``(b(s) − b(0)) V/s ≤ 0.85 A`` for all s ≤ V. b(0) is reserved as the `wall_clearance`.
    c stretches distances and does not scale α₁, because its slope counts at all speeds alike.

    Args:
        settings: α₁, α₂ and the hold, with the axle's greatest acceleration.
        axle: what limits the drive.
    """

    def is_met(c: float) -> bool:
        alpha1 = settings.alpha1 if c == 1.0 else settings.alpha1.stretched(c)
        stretched = replace(settings, alpha1=alpha1)
        bound_at_rest, needed_braking = _bound(stretched, 0.0, 0.0), 0.0
        for speed in np.linspace(0.0, axle.forward, SPEED_SAMPLES + 1)[1:].tolist():
            more = _bound(stretched, alpha1.inverse(speed), speed) - bound_at_rest
            needed_braking = max(needed_braking, more * axle.forward / speed)
        return needed_braking <= _USED * axle.braking

    return greatest_share(is_met)


def wall_clearance(settings: RowSettings, jerk: float) -> float:
    """Return the least h − m [m] at which a row requests nothing of a robot along a wall.

    Args:
        settings: α₁, α₂ and the hold.
        jerk: what the row reserves of the acceleration, `Axle.jerk` [m/s²].
    """
    low, high = 0.0, 1.0  # [m]
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _bound(settings, middle, 0.0) + jerk <= 0.0:
            high = middle
        else:
            low = middle
    return high


def _bound(settings: RowSettings, distance: float, speed: float) -> float:
    """Return b of the row of a wall at h − m = `distance` [m], neared at a `speed` [m/s]."""
    if settings.held:
        # kept, rate, quickening, speed, speed sideways, and distance from the core
        return _core.held_row(distance, -speed, 0.0, speed, 0.0, np.inf, settings.packed)[0]
    psi = settings.alpha1(distance) - speed
    return settings.alpha1.derivative(distance) * speed - settings.alpha2(psi)
