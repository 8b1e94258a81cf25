"""What α₁, U and a speed limit cannot satisfy together in a scene, in sentences for warnings."""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import layout
from hcbf_gym.barriers.braking import RESERVE, speed_left, stoppable, weakest
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.shape import TINY
from hcbf_gym.barriers.speed_limit import BRAKING
from hcbf_gym.models.input_sets import InputSet

SLOW = 0.15
"""The speed [m/s] below which a legged robot hardly walks; a speed limit should leave more."""


class Shortcoming(NamedTuple):
    """Something that α₁, U and a speed limit cannot satisfy in some of N scenes."""

    what: str  # its kind in a word, by which it is reported once
    scenes: Mask  # (N,) whether a scene has it
    promised: bool  # whether rank 1 is satisfied all the same
    text: str  # a sentence with the numbers


def shortcomings(
    scenes: BarrierSet,
    alpha1: ClassK,
    input_set: InputSet,
    speed_margin: float,
    fastest: float = np.inf,
) -> list[Shortcoming]:
    """Return what cannot be satisfied in N scenes; an empty list where everything can.

    Args:
        scenes: the N scenes.
        alpha1: α₁.
        input_set: U.
        speed_margin: what the row of a speed limit reserves besides its own margin [m/s].
        fastest: the greatest speed where there is no limit [m/s].
    """
    is_strict = scenes.priority == 1
    is_cap = is_strict & (scenes.kind == layout.SPEED_LIMIT)
    is_region = is_strict & scenes.is_region
    has_map = (is_strict & (scenes.kind == layout.MAPPED)).any(axis=1)
    has_zone = (is_strict & (scenes.kind == layout.ZONES)).any(axis=1)
    margins = np.where(is_cap, scenes.own_margin + speed_margin, 0.0)
    left = np.where(is_cap, speed_left(scenes.parameters[..., layout.V_MAX], margins), np.inf)
    speed = left.min(axis=1, initial=fastest)  # (N,) of the robot, by limits or its motors
    w_x, w_y = np.moveaxis(scenes.parameters[..., : layout.VELOCITY_Y + 1], -1, 0)
    region_speed = np.where(is_region, np.hypot(w_x, w_y), 0.0).max(axis=1, initial=0.0)
    can_close_in = (is_region.sum(axis=1) > 1) | has_map
    able = (1.0 - RESERVE) * weakest(input_set)
    candidates = [
        _flight(speed, region_speed),
        _slowness(speed, margins.max(axis=1, initial=0.0)),
        _stopping(np.where(can_close_in, speed, 0.0), stoppable(alpha1, input_set), able),
        _slowing(has_zone, able),
    ]
    if np.isinf(alpha1.hardest_speed):
        candidates += _of_linear(alpha1.derivative(0.0), speed + region_speed, able)
    return [shortcoming for shortcoming in candidates if shortcoming.scenes.any()]


def _flight(speed: Array, region_speed: Array) -> Shortcoming:
    """Compare speeds (N,) of the robot with those of the fastest regions [m/s]."""
    is_slower = speed <= region_speed
    text = (
        f"a strict region moves at {_most(region_speed, is_slower):.3g} m/s, and the robot has "
        f"{speed.min(initial=np.inf, where=is_slower):.3g} m/s after the margin of its speed "
        "limit; expected a higher v_max, so that it can step aside"
    )
    return Shortcoming("flight", is_slower, False, text)


def _slowness(speed: Array, margin: Array) -> Shortcoming:
    """Find speeds (N,) that the margins (N,) of speed limits make too low [m/s]."""
    is_slow = (speed < SLOW) & (margin > 0.0)
    text = (
        f"the speed limit leaves {speed.min(initial=np.inf, where=is_slow):.3g} m/s after its "
        f"margin of {_most(margin, is_slow):.3g} m/s; expected a higher v_max, or patience"
    )
    return Shortcoming("slowness", is_slow, True, text)


def _stopping(speed: Array, stoppable_speed: float, able: float) -> Shortcoming:
    """Compare speeds (N,) with the one [m/s] from which U stops where regions close in."""
    is_fast = np.isfinite(speed) & (speed > stoppable_speed)
    needed = able * _most(speed, is_fast) / stoppable_speed
    text = (
        f"where strict regions close in, {needed:.3g} m/s² stop the robot in time, and "
        f"{_ability(able)}; expected a v_max that leaves at most {stoppable_speed:.3g} m/s, or a "
        "flatter alpha1"
    )
    return Shortcoming("stopping", is_fast, False, text)


def _slowing(has_zone: Mask, able: float) -> Shortcoming:
    """Find scenes with a speed zone, if U cannot brake as its row requests."""
    text = (
        f"before a strict speed zone the robot brakes by {BRAKING:.3g} m/s², and "
        f"{_ability(able)}; expected a larger U, or zones of a lower rank"
    )
    return Shortcoming("slowing", has_zone & (able < BRAKING), False, text)


def _of_linear(gain: float, approach_speed: Array, able: float) -> list[Shortcoming]:
    """Find speeds (N,) [m/s] of approach to a region at which a linear α₁ requests too much."""
    is_hard = np.isfinite(approach_speed) & (gain * approach_speed > able)
    hardest = _most(approach_speed, is_hard)
    endless = (
        "a linear alpha1 requests more braking the faster the robot is, and the scene has no "
        "strict speed limit; expected v_max, or the logarithm"
    )
    late = (
        f"a linear alpha1 requests {gain * hardest:.3g} m/s² of braking at the speed limit, and "
        f"{_ability(able)}; expected a gain of at most {able / max(hardest, TINY):.3g}"
    )
    return [
        Shortcoming("speed", np.isinf(approach_speed), False, endless),
        Shortcoming("braking", is_hard, False, late),
    ]


def _ability(able: float) -> str:
    return f"U has {able:.3g} with a tenth in reserve"


def _most(values: Array, where: Mask) -> float:
    return float(values.max(initial=0.0, where=where))
