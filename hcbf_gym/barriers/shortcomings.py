"""What α₁, U and a speed limit cannot satisfy together in a scene, in sentences for warnings."""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import layout, speed_limit
from hcbf_gym.barriers.braking import RESERVE, speed_left, stoppable, weakest
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.shape import TINY
from hcbf_gym.models.input_sets import InputSet

SLOW = 0.15
"""The speed [m/s] below which a legged robot hardly walks; a speed limit should leave more."""


class Shortcoming(NamedTuple):
    """Something that α₁, U and a speed limit cannot satisfy in some of N scenes.

    Attributes:
        what: the kind of it in a word, by which it is reported once.
        scenes: (N,) whether a scene has it.
        promised: whether rank 1 is satisfied all the same.
        text: a sentence with the numbers.
    """

    what: str
    scenes: Mask
    promised: bool
    text: str


class _Strict(NamedTuple):
    """The conditions of rank 1 in N scenes, as far as braking depends on them."""

    speed: Array  # (N,) the speed that speed limits and motors leave after the margins [m/s]
    margin: Array  # (N,) the largest margin of a speed limit [m/s]; 0 without one
    region_speed: Array  # (N,) of the fastest region [m/s]
    can_close_in: Mask  # (N,) whether there are several regions, as cells of a map are
    has_zone: Mask  # (N,) whether there is a speed zone


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
    strict = _strict_conditions(scenes, speed_margin, fastest)
    able = (1.0 - RESERVE) * weakest(input_set)
    candidates = [
        _flight(strict),
        _slowness(strict),
        _stopping(strict, stoppable(alpha1, input_set), able),
        _slowing(strict, able),
    ]
    if np.isinf(alpha1.hardest_speed):
        gain, approach_speed = alpha1.derivative(0.0), strict.speed + strict.region_speed
        candidates += [_endless(approach_speed), _late_braking(gain, approach_speed, able)]
    return [one for one in candidates if one.scenes.any()]


def _strict_conditions(scenes: BarrierSet, speed_margin: float, fastest: float) -> _Strict:
    is_strict = scenes.priority == 1
    is_cap = is_strict & (scenes.kind == layout.SPEED_LIMIT)
    is_region = is_strict & scenes.is_region
    has_map = (is_strict & (scenes.kind == layout.MAPPED)).any(axis=1)
    reserved = scenes.own_margin + speed_margin
    speed = np.where(is_cap, speed_left(scenes.parameters[..., layout.V_MAX], reserved), np.inf)
    w_x = scenes.parameters[..., layout.VELOCITY_X]
    w_y = scenes.parameters[..., layout.VELOCITY_Y]
    return _Strict(
        speed=speed.min(axis=1, initial=fastest),
        margin=np.where(is_cap, reserved, 0.0).max(axis=1, initial=0.0),
        region_speed=np.where(is_region, np.hypot(w_x, w_y), 0.0).max(axis=1, initial=0.0),
        can_close_in=(is_region.sum(axis=1) > 1) | has_map,
        has_zone=(is_strict & (scenes.kind == layout.ZONES)).any(axis=1),
    )


def _flight(strict: _Strict) -> Shortcoming:
    is_faster = strict.region_speed >= strict.speed
    text = (
        f"a strict region moves at {_most(strict.region_speed, is_faster):.3g} m/s, and the robot "
        f"has {_least(strict.speed, is_faster):.3g} m/s after the margin of its speed limit; "
        "expected a higher v_max, so that it can step aside"
    )
    return Shortcoming("flight", is_faster, False, text)


def _slowness(strict: _Strict) -> Shortcoming:
    is_slow = (strict.speed < SLOW) & (strict.margin > 0.0)
    text = (
        f"the speed limit leaves {_least(strict.speed, is_slow):.3g} m/s after its margin of "
        f"{_most(strict.margin, is_slow):.3g} m/s; expected a higher v_max, or patience"
    )
    return Shortcoming("slowness", is_slow, True, text)


def _stopping(strict: _Strict, stoppable_speed: float, able: float) -> Shortcoming:
    is_fast = strict.can_close_in & np.isfinite(strict.speed) & (strict.speed > stoppable_speed)
    needed = able * _most(strict.speed, is_fast) / stoppable_speed
    text = (
        f"where strict regions close in, {needed:.3g} m/s² stop the robot in time, and "
        f"{_ability(able)}; expected a v_max that leaves at most {stoppable_speed:.3g} m/s, or a "
        "flatter alpha1"
    )
    return Shortcoming("stopping", is_fast, False, text)


def _slowing(strict: _Strict, able: float) -> Shortcoming:
    text = (
        f"before a strict speed zone the robot brakes by {speed_limit.BRAKING:.3g} m/s², and "
        f"{_ability(able)}; expected a larger U, or zones of a lower rank"
    )
    return Shortcoming("slowing", strict.has_zone & (able < speed_limit.BRAKING), False, text)


def _endless(approach_speed: Array) -> Shortcoming:
    text = (
        "a linear alpha1 requests more braking the faster the robot is, and the scene has no "
        "strict speed limit; expected v_max, or the logarithm"
    )
    return Shortcoming("speed", np.isinf(approach_speed), False, text)


def _late_braking(gain: float, approach_speed: Array, able: float) -> Shortcoming:
    is_hard = np.isfinite(approach_speed) & (gain * approach_speed > able)
    greatest_speed = _most(approach_speed, is_hard)
    text = (
        f"a linear alpha1 requests {gain * greatest_speed:.3g} m/s² of braking at the speed limit, "
        f"and {_ability(able)}; expected a gain of at most {able / max(greatest_speed, TINY):.3g}"
    )
    return Shortcoming("braking", is_hard, False, text)


def _ability(able: float) -> str:
    return f"U has {able:.3g} with a tenth in reserve"


def _most(values: Array, where: Mask) -> float:
    return float(values.max(initial=0.0, where=where))


def _least(values: Array, where: Mask) -> float:
    return float(values.min(initial=np.inf, where=where))
