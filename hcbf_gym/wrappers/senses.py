"""What the filter of N planar double integrators believes: states looked at, plants watched.

A state that is not finite, of no time or too old is not believed: the model propagates the last one
that was, under the input that was applied. Two signals tell whether the plant is the declared one:
`monitor` has the input's. The motion's compares the body's position with its velocity. With
``τ = WINDOW``, over every sample of length T,

    r ← (1 − T/τ) r + Δp − T (v + v')/2,        m ← (1 − T/τ) m + T (v + v')/2,

and the alarm is raised where ``‖r‖ > DRIFT + SHARE max(‖m‖, ‖m + r‖) + κ √tr P``.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.models.plant import Reason
from hcbf_gym.models.reduced_order import double_integrator_step
from hcbf_gym.wrappers.monitor import WINDOW, account

Array = NDArray[np.float64]

DRIFT = 0.01
"""What position and velocity may drift apart in any case [m]: rounding of a plant's own steps."""
SHARE = 0.1
"""Share of the motion that they may drift apart besides."""

STATE, CLOCK = int(Reason.STATE), int(Reason.CLOCK)
INPUT, MOTION = int(Reason.INPUT), int(Reason.MOTION)

MEMORY = np.dtype(
    (
        np.record,
        [
            ("input_error", "f8", 3),  # as `monitor.account` records it
            ("drift", "f8", 2),  # r [m]
            ("motion", "f8", 2),  # m [m]
            ("body", "f8", 4),  # position [m] and velocity [m/s] at the last sample
            ("model", "f8", 2),  # velocity of the model at the last sample [m/s]
            ("input", "f8", 2),  # applied since [m/s²]
            ("state", "f8", 4),  # believed at the last sample
            ("time", "f8"),  # of the last state that was believed [s]
            ("follows", "u1"),  # whether the last sample was believed
            ("known", "u1"),  # whether any was, since the reset
            ("alarm", "i8"),  # a `Reason`, until the next reset
        ],
    )
)
"""What is remembered of one plant from step to step; zeros at a reset."""


class Sensed(NamedTuple):
    """What is known of N plants, as `models.plant.Estimate` says it, with a leading N.

    Attributes:
        x: (N, 4).
        t: (N,).
        model: (N, 4).
        lag: (N, 4).
        covariance: (N, 4, 4).
        fault: (N,) a `Reason` that was found on the way here; 0 for none.
    """

    x: Array
    t: Array
    model: Array
    lag: Array
    covariance: Array
    fault: NDArray[np.int64]


@njit(cache=True, error_model="numpy")
def look(memory: np.record, plants: Sensed, i: int, period: float) -> int:
    """Return why plant `i` is not believed, 0 if it is; where it is not, write what the model says.

    Args:
        memory: a `MEMORY` record, written to.
        plants: the row `i` is replaced where it is not believed.
        i: which plant.
        period: T [s]; 0 where it is not known.
    """
    reason = plants.fault[i] if plants.fault[i] < INPUT else 0
    x, t = plants.x[i], plants.t[i]
    if reason == 0 and not _is_sound(plants, i):
        reason = STATE
    if reason == 0 and not np.isfinite(t):
        reason = CLOCK
    if reason == 0 and memory.known and t <= memory.time and (period > 0.0 or t != 0.0):
        reason = CLOCK
    if reason == 0:
        memory.state[:] = x
        memory.time, memory.known = t, 1
        return 0
    memory.follows = 0
    if memory.known and period > 0.0:
        state = memory.state
        state[0], state[1], state[2], state[3] = double_integrator_step(
            state, memory.input, period, np.inf
        )
    x[:] = memory.state
    plants.model[i, :] = x
    plants.lag[i, :] = 0.0
    plants.covariance[i, :, :] = 0.0
    plants.t[i] = memory.time
    return reason


@njit(cache=True, error_model="numpy")
def _is_sound(plants: Sensed, i: int) -> bool:
    """Tell whether all that is said of a plant is finite, and its covariance may be one."""
    sound = True
    for k in range(4):
        sound &= np.isfinite(plants.x[i, k] + plants.model[i, k] + plants.lag[i, k])
    total, p = 0.0, plants.covariance[i]
    for j in range(4):
        for k in range(4):
            total += p[j, k]
    if total == 0.0 and p[0, 0] == 0.0 and p[1, 1] == 0.0:
        return sound  # the truth, or near it
    for j in range(4):
        sound &= p[j, j] >= 0.0 and np.isfinite(p[j, j])
        for k in range(4):
            sound &= p[j, k] * p[j, k] <= p[j, j] * p[k, k] * (1.0 + 1e-6) + 1e-18
    return sound


@njit(cache=True, error_model="numpy")
def watch(
    memory: np.record, plants: Sensed, i: int, period: float, radius: float, confidence: float
) -> float:
    """Compare a believed sample with the one before, raise what alarms there are, return √E.

    Args:
        memory: a `MEMORY` record, written to.
        plants: of which `i` is looked at.
        i: which plant.
        period: T [s]; 0 where it is not known.
        radius: the largest norm of an input [m/s²].
        confidence: κ.
    """
    model, lag = plants.model[i], plants.lag[i]
    if memory.alarm == 0 and plants.fault[i] >= INPUT:
        memory.alarm = plants.fault[i]
    error = np.sqrt(memory.input_error[0])
    if memory.follows and period > 0.0:
        missed = chosen = 0.0
        for k in range(2):
            miss = (model[2 + k] - memory.model[k]) / period - memory.input[k]
            missed += miss * miss
            chosen += memory.input[k] * memory.input[k]
        error, alarm = account(memory.input_error, missed, chosen, period / WINDOW, radius)
        if alarm and memory.alarm == 0:
            memory.alarm = INPUT
        strays = _strays(memory, model, lag, plants.covariance[i], period, confidence)
        if strays and memory.alarm == 0:
            memory.alarm = MOTION
    for k in range(4):
        memory.body[k] = model[k] + lag[k]
    memory.model[0], memory.model[1] = model[2], model[3]
    memory.follows = 1
    return error


@njit(cache=True, error_model="numpy")
def _strays(
    memory: np.record, model: Array, lag: Array, covariance: Array, period: float, confidence: float
) -> bool:
    """Tell whether the body's position has drifted from what its velocity says."""
    keep = max(0.0, 1.0 - period / WINDOW)
    drift2 = told2 = seen2 = 0.0
    for k in range(2):
        position, velocity = model[k] + lag[k], model[2 + k] + lag[2 + k]
        told = 0.5 * period * (velocity + memory.body[2 + k])
        memory.drift[k] = keep * memory.drift[k] + position - memory.body[k] - told
        memory.motion[k] = keep * memory.motion[k] + told
        drift2 += memory.drift[k] ** 2
        told2 += memory.motion[k] ** 2
        seen2 += (memory.motion[k] + memory.drift[k]) ** 2
    spread = confidence * np.sqrt(max(0.0, covariance[0, 0] + covariance[1, 1]))
    return np.sqrt(drift2) > DRIFT + SHARE * np.sqrt(max(told2, seen2)) + spread
