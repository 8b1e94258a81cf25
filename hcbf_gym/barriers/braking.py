r"""Whether U can brake what α₁ and α₂ request, and by how much α₁ must shrink if not.

The model is the double integrator. On ψ = 0 the robot approaches a strict region at the speed
s = α₁(h), and the row requests the deceleration

.. math:: D(s) = s\, α_1'(α_1^{-1}(s)),

for the paper's logarithm at most φ₁²φ₂/(φ₃ e), at s = φ₁; for a linear α₁ gain · s, the more the
faster. For ψ > 0 it requests less, whatever α₂ is. `docs/rows.md` proves it, and derives how much
more the row of a held input requests.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers import layout, speed_limit
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.rows import RowSettings
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.shape import TINY
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.input_sets import InputSet

RESERVE = 0.1
"""Share of what U can do in its worst direction that single rows leave: for a second row that pulls
another way, and for the tolerance of the programs."""

SLOW = 0.15
"""A robot to which a speed limit leaves less hardly walks [m/s]."""

PLACES, BEYOND = 200, 4.0
"""How many distances from the region are sampled, up to this multiple of the hardest speed."""


def weakest(input_set: InputSet) -> float:
    """Return the radius of the largest ball around 0 in U, what it can do in any direction."""
    _, b = input_set.halfspaces()
    return max(0.0, float((-b).min()))


def requested(settings: RowSettings, fastest: float = np.inf) -> float:
    """Return the largest b of a strict row at a state with ψ ≥ 0, the deceleration it requests.

    The robot drives straight at the region. What the turn of the gradient takes of a held input
    beside a polygon's corner, where the robot is slow, does not count.

    Args:
        settings: α₁, α₂ and the hold.
        fastest: the greatest approach speed there can be; α₁ linear needs it.
    """
    alpha1 = settings.alpha1
    top = min(BEYOND * alpha1.hardest_speed, fastest)
    speed = np.linspace(0.0, top, PLACES + 1)[1:]  # s = α₁(h − m) on ψ = 0
    kept = np.array([alpha1.inverse(s) for s in speed])
    if settings.period is None or settings.u_max is None:
        return float(max(s * alpha1.derivative(k) for s, k in zip(speed, kept, strict=True)))
    period, u_max = settings.period, settings.u_max
    half = 0.5 * u_max * period**2
    end = kept - period * speed
    chord = np.array([alpha1.derivative(max(abs(e - half), abs(e + half))) for e in end])
    promised = alpha1.values(end - half) + chord * half
    rows = (speed - promised) / (period + 0.5 * chord * period**2)
    return float(rows.max())


def greatest(fits: Callable[[float], bool]) -> float:
    """Return by bisection the greatest share c in [0, 1] that fits, where smaller ones do, too."""
    if fits(1.0):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if fits(middle):
            low = middle
        else:
            high = middle
    return low


def share(settings: RowSettings, brakes: float) -> float:
    """Return the greatest c in [0, 1] with which the robot can brake what c·α₁ requests.

    It is 1 where α₁ requests more the faster the robot is: there it depends on the scene.

    Args:
        settings: α₁, α₂ and the hold.
        brakes: with how much it stops [m/s²], of which `RESERVE` is left.
    """
    alpha1, able = settings.alpha1, (1.0 - RESERVE) * brakes
    if np.isinf(alpha1.hardest_speed):
        return 1.0
    return greatest(lambda c: requested(replace(settings, alpha1=alpha1.scaled(c))) <= able)


def stoppable(alpha1: ClassK, input_set: InputSet) -> float:
    """Return the greatest speed [m/s] from which U stops the robot where regions close in.

    `RESERVE` of U is left. The slope of α₁ at 0 is how close to a region a robot of some speed is.
    """
    return 2.0 * (1.0 - RESERVE) * weakest(input_set) / alpha1.derivative(0.0)


def speed_left(v_max: object, margin: Any) -> Any:
    """Return the speed that a cap leaves the model, ``√(v_max² − 2 v_max · margin)`` [m/s].

    Args:
        v_max: the cap [m/s], a number or an array.
        margin: what its row reserves between h and zero [m/s].
    """
    return np.sqrt(np.maximum(0.0, v_max * (v_max - 2.0 * margin)))


class Shortcoming(NamedTuple):
    """Something that α₁, U and a speed limit cannot satisfy in some of N scenes.

    Attributes:
        what: in a word, so that it is reported once.
        scenes: (N,) where.
        promised: whether rank 1 is satisfied all the same.
        text: a sentence with the numbers.
    """

    what: str
    scenes: Mask
    promised: bool
    text: str


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
    strict = scenes.priority == 1
    caps, regions = strict & (scenes.kind == layout.SPEED_LIMIT), strict & scenes.is_region
    kept = scenes.own_margin + speed_margin
    left = np.where(caps, speed_left(scenes.parameters[..., layout.V_MAX], kept), np.inf)
    left = left.min(axis=1, initial=fastest)  # by strict limits, or the motors
    margin = np.where(caps, kept, 0.0).max(axis=1, initial=0.0)
    w_x, w_y = np.moveaxis(scenes.parameters[..., : layout.VELOCITY_Y + 1], -1, 0)
    moves = np.where(regions, np.hypot(w_x, w_y), 0.0).max(axis=1, initial=0.0)
    is_map, is_zone = (strict & (scenes.kind == one) for one in (layout.MAPPED, layout.ZONES))
    narrows = (regions.sum(axis=1) > 1) | is_map.any(axis=1)  # regions can close in on the robot
    able = (1.0 - RESERVE) * weakest(input_set)
    steep, stopped = alpha1.derivative(0.0), stoppable(alpha1, input_set)
    brakes, reserve = speed_limit.BRAKING, f"U has {able:.3g} with a tenth in reserve"
    flees, slow = moves >= left, (left < SLOW) & (margin > 0.0)
    fast = narrows & np.isfinite(left) & (left > stopped)
    texts = {
        "flight": f"a strict region moves at {_most(moves, flees):.3g} m/s, and the robot has "
        f"{_least(left, flees):.3g} m/s after the margin of its speed limit; expected a higher "
        "v_max, so that it can step aside",
        "slowness": f"the speed limit leaves {_least(left, slow):.3g} m/s after its margin of "
        f"{_most(margin, slow):.3g} m/s; expected a higher v_max, or patience",
        "stopping": f"where strict regions close in, {able * _most(left, fast) / stopped:.3g} "
        f"m/s² stop the robot in time, and {reserve}; expected a v_max that leaves at most "
        f"{stopped:.3g} m/s, or a flatter alpha1",
        "slowing": f"before a strict speed zone the robot brakes by {brakes:.3g} m/s², and "
        f"{reserve}; expected a larger U, or zones of a lower rank",
    }
    where = {"flight": flees, "slowness": slow, "stopping": fast}
    where["slowing"] = is_zone.any(axis=1) & (able < brakes)
    found = [
        Shortcoming(what, mask, what == "slowness", texts[what]) for what, mask in where.items()
    ]
    if np.isinf(alpha1.hardest_speed):
        found += _of_linear(steep, left + moves, able, reserve)
    return [one for one in found if one.scenes.any()]


def _of_linear(gain: float, speed: Array, able: float, reserve: str) -> list[Shortcoming]:
    """Return what a linear α₁ requests in vain at the speeds (N,) at which regions are met."""
    hard = np.isfinite(speed) & (gain * speed > able)
    most = _most(speed, hard)
    endless = (
        "a linear alpha1 requests more braking the faster the robot is, and the scene has no "
        "strict speed limit; expected v_max, or the logarithm"
    )
    late = (
        f"a linear alpha1 requests {gain * most:.3g} m/s² of braking at the speed limit, and "
        f"{reserve}; expected a gain of at most {able / max(most, TINY):.3g}"
    )
    return [
        Shortcoming("speed", np.isinf(speed), False, endless),
        Shortcoming("braking", hard, False, late),
    ]


def _most(values: Array, where: Mask) -> float:
    return float(values.max(initial=0.0, where=where))


def _least(values: Array, where: Mask) -> float:
    return float(values.min(initial=np.inf, where=where))


def check_limits(
    scenes: BarrierSet,
    period: float | None,
    u_max: float,
    speed_margin: float = 0.0,
    turn: float = 0.0,
) -> None:
    """Refuse speed limits and speed zones that no input can satisfy.

    Args:
        scenes: of the plants.
        period: how long an input is held [s]; None where that is not known.
        u_max: the largest norm of an input [m/s²].
        speed_margin: what the rows of speed limits reserve besides their own margins [m/s].
        turn: the greatest turning rate of a differential drive [rad/s]; 0 for all others.

    Raises:
        InvalidInputError: if a margin leaves nothing of a speed limit, or a held input can pass
            it from rest within one period.
    """
    capped = scenes.kind == layout.SPEED_LIMIT
    v_max = scenes.parameters[capped, layout.V_MAX]
    margin = scenes.own_margin[capped] + speed_margin
    if len(v_max):
        worst = int(np.argmin(v_max - 2.0 * margin))
        speed_limit.check_leaves_speed("speed limit", v_max[worst], margin[worst])
    if period is None:
        return
    limit = scenes.parameters[scenes.kind == layout.ZONES, layout.V_MAX]
    lowest = speed_limit.least_limit(period, u_max, speed_margin, turn)
    if (limit < lowest).any():
        raise InvalidInputError(
            f"speed zone: got {limit.min():g} m/s, expected at least {lowest:g} m/s: its row "
            f"reserves {speed_margin:g} m/s, and an input passes the rest within one period"
        )
    gained = u_max * period
    least = np.sqrt(v_max * (v_max - 2.0 * margin)).min(initial=np.inf)
    if least <= gained:
        raise InvalidInputError(
            f"speed limit: got {least:g} m/s after its margin, expected above {gained:g} m/s, "
            "which an input reaches within one period: sample faster or allow smaller inputs"
        )
