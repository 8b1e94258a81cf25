"""Is the plant the one that was declared? What was chosen and what is observed tell.

**The input.** At every sample the state's change over one period is compared with what the model
makes of the chosen input. The difference, as an input Δu, says two things.

``model_error`` is its root mean square with the time constant `WINDOW`,
``E ← E + (T/τ)(‖Δu‖² − E)``.

The alarm counts samples, so that it makes no difference how large they are. A sample tells
something where the filter asked for something, ``‖u‖ > FLOOR ū`` with ū the largest input; then it
is missed where ``‖Δu‖ > SHARE ‖u‖``. The alarm is raised where most of the last `TELLING` samples
that tell were missed. A gain of 2 misses every one that is not cut off at the limits.

A double integrator that meets most of them to ``‖Δu‖ ≤ EXACT ‖u‖`` is exact, and few
misses are significant there: where more than `FEW` of them are off by ``OFF_EXACT ‖u‖``, that
alarms, too. So every third input that is reversed, or braking that is weakened, is seen.

**The motion.** With s what no input explains of the change from one sample to the next, Δ the
change, and ``τ = WINDOW``, over every sample of length T,

    r ← (1 − T/τ) r + s,   m ← (1 − T/τ) m + Δ,   m' ← (1 − T/τ) m' + Δ − s,
    c ← (1 − T/τ) c + APART T ‖ẋ' − ẋ‖.

The alarm is raised where at `IN_A_ROW` samples ``‖r‖ > rest + OFF max(‖m‖, ‖m'‖) + c + κ √tr P``: c
is what two ways to integrate may be apart, where the velocity turns or changes. Of a planar double
integrator s is ``Δp − T (v + v')/2``, which is exact, so that c is 0 of one that is its model;
`model_monitor` has s for any model.
"""

import numpy as np

from hcbf_gym.arrays import Record
from hcbf_gym.compilation import kernel
from hcbf_gym.models.plant import FIRST_ALARM, Reason

WINDOW = 0.5
"""τ, over which squared errors are averaged [s]."""
FLOOR = 0.05
"""Share of the largest input below which a chosen input tells nothing: rounding, noise at rest."""
SHARE = 0.45
"""Share of the chosen input from which on it was missed: a gain of one half is off by 0.5 of it."""
TELLING = 25
"""Samples over which the share of misses is averaged."""
LEAST_SAMPLES = 10
"""Telling samples since the reset before which no alarm is raised."""
MOST = 0.5
"""Share of misses above which the alarm is raised; of exact samples above which a plant is so."""
EXACT, OFF_EXACT = 0.02, 0.1
"""Share of the chosen input up to which it was met exactly, and from which on it was not at all."""
FEW = 0.1
"""Share of samples that are off above which an exact plant alarms: three in a row."""

REST = 0.01
"""What a position and its velocity may drift apart in any case [m]: rounding of a plant's steps."""
OFF = 0.1
"""Share of the motion from which on it is another one than the model's."""
APART = 0.6
"""By how much of T (ẋ' − ẋ) two ways to integrate differ: one half for Euler's, and rounding."""
IN_A_ROW = 3
"""Samples in a row at which the motion must be off."""

INPUT, MOTION, ALARM = int(Reason.INPUT), int(Reason.MOTION), int(FIRST_ALARM)

MEMORY = [
    ("error", "f8"),  # E
    ("missed", "f8"),  # the share of misses
    ("exact", "f8"),  # the share that was met exactly
    ("off", "f8"),  # the share that was off by more than an exact plant ever is
    ("samples", "f8"),  # that tell
    ("bend", "f8"),  # c
    ("in_a_row", "f8"),  # samples at which the motion was off
]
"""What is remembered of both signals; zeros at a reset."""
PLANAR_MEMORY = [
    ("drift", "f8", 2),  # r [m]
    ("motion", "f8", 2),  # m [m]
    ("body", "f8", 4),  # position [m] and velocity [m/s] at the last sample
]
"""What is remembered besides of the motion in the plane; zeros at a reset."""


@kernel(error_model="numpy", inline="always")
def fade(period: float) -> float:
    """Return by how much sums over τ fade in a period."""
    return max(0.0, 1.0 - period / WINDOW)


@kernel(error_model="numpy")
def strays(
    memory: Record,
    off: float,
    moved: float,
    change: float,
    rest: float,
    spread: float,
    period: float,
) -> bool:
    """Account for the motion of one sample, and return whether that alarms.

    Args:
        memory: a record with the fields of `MEMORY`, written to.
        off: ‖r‖.
        moved: the greater of ‖m‖ and ‖m'‖.
        change: ‖ẋ' − ẋ‖.
        rest: what they may be apart in any case.
        spread: κ √tr P.
        period: T [s].
    """
    memory.bend = fade(period) * memory.bend + APART * period * change
    bound = rest + OFF * moved + memory.bend + spread
    memory.in_a_row = memory.in_a_row + 1.0 if off > bound else 0.0
    return memory.in_a_row >= IN_A_ROW


@kernel(error_model="numpy", inline="always")
def note_body(memory: Record, body: tuple[float, float, float, float]) -> None:
    """Note where a body is, and its velocity, for the next sample."""
    for k in range(4):
        memory.body[k] = body[k]


@kernel(error_model="numpy")
def drifts(
    memory: Record,
    body: tuple[float, float, float, float],
    period: float,
    besides: float,
    exact: bool,
) -> bool:
    """Return whether a body's position has drifted from what its velocity says.

    Args:
        memory: a record with the fields of `MEMORY` and `PLANAR_MEMORY`, written to.
        body: its position [m] and velocity [m/s].
        period: since the sample before [s].
        besides: what the position may be off [m].
        exact: whether the body is its model.
    """
    last, drift, motion = memory.body, memory.drift, memory.motion
    left = fade(period)
    drift2 = meant2 = seen2 = changed2 = 0.0
    for k in range(2):
        meant = 0.5 * period * (body[2 + k] + last[2 + k])
        drift[k] = left * drift[k] + body[k] - last[k] - meant
        motion[k] = left * motion[k] + meant
        drift2 += drift[k] ** 2
        meant2 += motion[k] ** 2
        seen2 += (motion[k] + drift[k]) ** 2
        changed2 += (body[2 + k] - last[2 + k]) ** 2
    off, moved = np.sqrt(drift2), np.sqrt(max(meant2, seen2))
    change = 0.0 if exact else np.sqrt(changed2)
    return strays(memory, off, moved, change, REST, besides, period)
