"""Gaits as data, and the clock that says which foot stands."""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.compilation import kernel

EARLY_TOUCHDOWN = 0.6  # share of the swing after which a touching foot becomes stance
RESTING = -1.0  # what the clock shows while all feet are held down
# share of the period by which a switch may come early: a sum of ticks is rounded, and without this
# a foot would swing a tick longer in some strides than in others
ROUNDING = 1e-6


class Gait(NamedTuple):
    """When each foot swings.

    Attributes:
        period: of a stride [s].
        duty: share of the period that a foot stands.
        offsets: phase of FR, FL, RR, RL at time zero; a foot stands while its phase is below duty.
        rests: whether all feet stay down while nothing is asked and nothing disturbs.
        max_speed: up to which it walks well [m/s].
    """

    period: float
    duty: float
    offsets: tuple[float, float, float, float]
    rests: bool
    max_speed: float


# the same fields as one record, which compiled code reads
GAIT = np.dtype(
    (
        np.record,
        [
            ("period", "f8"),
            ("duty", "f8"),
            ("offsets", "f8", 4),
            ("rests", "u1"),
            ("max_speed", "f8"),
        ],
    )
)

_TROT = Gait(period=0.26, duty=0.5, offsets=(0.0, 0.5, 0.5, 0.0), rests=False, max_speed=1.8)
GAITS = {
    "trot": _TROT,
    "stand": _TROT._replace(rests=True),
    "walk": Gait(period=0.6, duty=0.75, offsets=(0.5, 0.0, 0.75, 0.25), rests=False, max_speed=0.4),
}


class FootPhases(NamedTuple):
    """The gait's answer for one tick.

    Attributes:
        stance: (4,) bool, feet that carry.
        remaining: (4,) until touchdown, 0 for feet in stance [s].
    """

    stance: Mask
    remaining: Array


@kernel()
def foot_phases(gait: Gait, clock: float, contact: Mask) -> FootPhases:
    """Return what each foot does at `clock` [s], given which feet (4,) touch."""
    stance = np.ones(4, dtype=np.bool_)
    remaining = np.zeros(4)
    if clock < 0.0:
        return FootPhases(stance, remaining)
    for foot in range(4):
        phase = (clock / gait.period + gait.offsets[foot] + ROUNDING) % 1.0
        swung = (phase - gait.duty) / (1.0 - gait.duty)
        if swung < 0.0 or (contact[foot] and swung > EARLY_TOUCHDOWN):
            continue
        stance[foot] = False
        remaining[foot] = (1.0 - phase) * gait.period
    return FootPhases(stance, remaining)


@kernel()
def advance_clock(gait: Gait, clock: float, quiet: bool, dt: float) -> float:
    """Return the clock [s] one tick later.

    A gait that rests starts to step at once when it is no longer quiet, and stops only where a pair
    of feet has just landed.
    """
    if clock < 0.0:
        return RESTING if quiet else 0.0
    before = clock / gait.period + ROUNDING
    after = (clock + dt) / gait.period + ROUNDING
    landed = after // 0.5 > before // 0.5
    return RESTING if gait.rests and quiet and landed else clock + dt
