"""What the filter of N planar double integrators believes: states looked at, plants watched.

A state that is not finite or too far away, of no time or too old is not believed: the model
propagates the last one that was, under the input that was applied. Two signals tell whether the
plant is the declared one: `monitor` has the input's. The motion's compares the body's position with
its velocity. With
``τ = WINDOW``, over every sample of length T,

    r ← (1 − T/τ) r + Δp − T (v + v')/2,        m ← (1 − T/τ) m + T (v + v')/2,
    c ← (1 − T/τ) c + .6 T ‖v' − v‖,

and the alarm is raised where ``‖r‖ > DRIFT + SHARE max(‖m‖, ‖m + r‖) + c + κ √tr P``: c is what
the way between two samples may bend, where the velocity turns or changes between them.
"""

from typing import Any

import numpy as np
from numba import njit

from hcbf_gym.barriers import margins
from hcbf_gym.filtering import verdict
from hcbf_gym.filtering.belief import are_near, is_covariance
from hcbf_gym.filtering.monitor import ACCOUNT, WINDOW, account, breaks_off
from hcbf_gym.models.plant import Reason
from hcbf_gym.models.reduced_order import double_integrator_step

DRIFT = 0.01
"""What position and velocity may drift apart in any case [m]: rounding of a plant's own steps."""
SHARE = 0.1
"""Share of the motion that they may drift apart besides."""

STATE, CLOCK = int(Reason.STATE), int(Reason.CLOCK)
INPUT, MOTION = int(Reason.INPUT), int(Reason.MOTION)

PLANT = np.dtype(
    (
        np.record,
        [
            # what is said of it now, as `models.plant.Estimate` has it
            ("x", "f8", 4),
            ("time", "f8"),
            ("model", "f8", 4),
            ("lag", "f8", 4),
            ("covariance", "f8", (4, 4)),
            ("elapsed", "f8"),  # since the sample before [s]; 0 where that is not known
            ("fault", "i8"),  # a `Reason` that was found on the way here; 0 for none
            ("has_model", "i8"),  # whether the model has a state of its own; x is that if not
            # where guidance leads
            ("way", "f8", 3),  # a_x, a_y and b of its row
            ("reachable", "f8"),  # through which rank
            ("zone", "f8"),  # the rank of the map's zone that it stands in, 0 for none
            # what is remembered from step to step
            *ACCOUNT,
            ("drift", "f8", 2),  # r [m]
            ("motion", "f8", 2),  # m [m]
            ("bend", "f8"),  # c [m]
            ("body", "f8", 4),  # position [m] and velocity [m/s] at the last sample
            ("expected", "f8", 2),  # velocity of the model at the last sample [m/s]
            ("vague", "f8", 3),  # xx, xy and yy of its covariance at the last sample [m²/s²]
            ("growth", "f8"),  # what that grew by when it grew last [m²/s²]
            ("input", "f8", 2),  # applied since [m/s²]
            ("believed", "f8", 4),  # the last state that was
            ("believed_at", "f8"),  # its time [s]
            ("follows", "i8"),  # whether the last sample was believed
            ("known", "i8"),  # whether any was, since the reset
            *verdict.MEMORY,
            ("alarm", "i8"),  # a `Reason`, until the next reset
        ],
    )
)
"""What is known of one plant; zeros at a reset."""


@njit(cache=True, error_model="numpy")
def look(plant: Any) -> int:
    """Return why a plant is not believed, 0 if it is; where it is not, write what the model says.

    Args:
        plant: a `PLANT` record, written to.
    """
    x, t, elapsed = plant.x, plant.time, plant.elapsed
    if plant.has_model == 0:
        plant.model[:] = x
    reason = plant.fault if plant.fault < INPUT else 0
    if reason == 0 and not _is_sound(plant):
        reason = STATE
    if reason == 0 and not np.isfinite(t):
        reason = CLOCK
    if reason == 0 and plant.known and t <= plant.believed_at and (elapsed > 0.0 or t != 0.0):
        reason = CLOCK
    state = plant.believed
    if reason == 0:
        _grow(plant)
        state[:] = x
        plant.believed_at = t
        plant.known = 1
        return 0
    plant.follows = 0
    if plant.known and elapsed > 0.0:
        state[0], state[1], state[2], state[3] = double_integrator_step(
            state, plant.input, elapsed, np.inf
        )
    x[:] = state
    plant.model[:] = state
    plant.lag[:] = 0.0
    plant.covariance[:, :] = 0.0
    plant.time = plant.believed_at
    return reason


@njit(cache=True, error_model="numpy", inline="always")
def _grow(plant: Any) -> None:
    """Note by how much the velocity's covariance grows in one period; a fix does not change that.

    Of a sample that follows none all of it is taken, as nothing is known of how it grows.
    """
    covariance = plant.covariance
    if plant.follows == 0:
        plant.vague[:] = 0.0
    elif covariance[2, 2] + covariance[3, 3] + plant.vague[0] + plant.vague[2] == 0.0:
        return  # the truth, as before
    grown = margins.growth_of(covariance, plant.vague)
    if grown > 0.0 or plant.follows == 0:
        plant.growth = grown
    plant.vague[0], plant.vague[1] = covariance[2, 2], covariance[2, 3]
    plant.vague[2] = covariance[3, 3]


@njit(cache=True, error_model="numpy")
def _is_sound(plant: Any) -> bool:
    """Tell whether a plant is where anything can be, and its covariance may be one."""
    near = are_near(plant.x) and are_near(plant.model) and are_near(plant.lag)
    return near and is_covariance(plant.covariance)


@njit(cache=True, error_model="numpy")
def watch(plant: Any, radius: float, confidence: float, apart: float) -> float:
    """Compare a believed sample with the one before, raise what alarms there are, return √E.

    Args:
        plant: a `PLANT` record, written to.
        radius: the largest norm of an input [m/s²].
        confidence: κ.
        apart: by how much of T ‖v' − v‖ the way may bend between two samples; 0 of a plant that is
            its model, whose trapezoids are exact.
    """
    model, lag, period = plant.model, plant.lag, plant.elapsed
    if plant.alarm == 0 and plant.fault >= INPUT:
        plant.alarm = plant.fault
    if plant.follows and period > 0.0:
        missed = chosen = 0.0
        for k in range(2):
            miss = (model[2 + k] - plant.expected[k]) / period - plant.input[k]
            missed += miss * miss
            chosen += plant.input[k] * plant.input[k]
        alarm = account(plant, missed, chosen, period / WINDOW, radius)
        if (alarm or breaks_off(plant)) and plant.alarm == 0:
            plant.alarm = INPUT
        strays = _strays(plant, period, confidence, apart)
        if strays and plant.alarm == 0:
            plant.alarm = MOTION
    for k in range(4):
        plant.body[k] = model[k] + lag[k]
    plant.expected[0] = model[2]
    plant.expected[1] = model[3]
    plant.follows = 1
    return np.sqrt(plant.error)


@njit(cache=True, error_model="numpy")
def _strays(plant: Any, period: float, confidence: float, apart: float) -> bool:
    """Tell whether the body's position has drifted from what its velocity says."""
    model, lag, body, covariance = plant.model, plant.lag, plant.body, plant.covariance
    drift, motion = plant.drift, plant.motion
    keep = max(0.0, 1.0 - period / WINDOW)
    drift2 = told2 = seen2 = changed2 = 0.0
    for k in range(2):
        position = model[k] + lag[k]
        velocity = model[2 + k] + lag[2 + k]
        told = 0.5 * period * (velocity + body[2 + k])
        drift[k] = keep * drift[k] + position - body[k] - told
        motion[k] = keep * motion[k] + told
        drift2 += drift[k] ** 2
        told2 += motion[k] ** 2
        seen2 += (motion[k] + drift[k]) ** 2
        changed2 += (velocity - body[2 + k]) ** 2
    plant.bend = keep * plant.bend + apart * period * np.sqrt(changed2)
    spread = confidence * np.sqrt(max(0.0, covariance[0, 0] + covariance[1, 1]))
    return np.sqrt(drift2) > DRIFT + SHARE * np.sqrt(max(told2, seen2)) + plant.bend + spread
