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
from typing import Any

import numpy as np

from hcbf_gym.barriers import layout, speed_limit
from hcbf_gym.barriers.class_k import ClassK
from hcbf_gym.barriers.rows import RowSettings
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.input_sets import InputSet

RESERVE = 0.1
"""The share of what U can do in its worst direction that a single row leaves unused: for a second
row with another normal, and for the tolerance of the programs."""

SPEED_SAMPLES = 200
"""The number of approach speeds at which the deceleration that a row requests is evaluated."""

_TOP_SPEED = 4.0  # the largest of these speeds, relative to `ClassK.hardest_speed`


def weakest(input_set: InputSet) -> float:
    """Return the radius of the largest ball around 0 in U, what it can do in any direction."""
    _, b = input_set.halfspaces()
    return max(0.0, float((-b).min()))


def requested(settings: RowSettings, fastest: float = np.inf) -> float:
    """Return the largest b of a strict row at a state with ψ ≥ 0, the deceleration it requests.

    The robot drives straight at the region. The turn of the gradient beside a polygon's corner is
    left out: it takes some of a held input, but only where the robot is slow.

    Args:
        settings: α₁, α₂ and the hold.
        fastest: the greatest approach speed there can be; α₁ linear needs it.
    """
    alpha1 = settings.alpha1
    top_speed = min(_TOP_SPEED * alpha1.hardest_speed, fastest)
    speed = np.linspace(0.0, top_speed, SPEED_SAMPLES + 1)[1:]
    distance = np.array([alpha1.inverse(s) for s in speed])  # h − m on ψ = 0, where s = α₁(h − m)
    if settings.period is None or settings.u_max is None:
        slope = np.array([alpha1.derivative(d) for d in distance])
        return float((speed * slope).max())
    period, u_max = settings.period, settings.u_max
    # within ± half of the distance after a period without input, α₁ is at least its value at the
    # near end plus its flattest slope, that at the largest |distance|, times the distance from it
    half = 0.5 * u_max * period**2
    after = distance - period * speed
    slope = np.array([alpha1.derivative(max(abs(d - half), abs(d + half))) for d in after])
    permitted_speed = alpha1.values(after - half) + slope * half
    bounds = (speed - permitted_speed) / (period + 0.5 * slope * period**2)
    return float(bounds.max())


def greatest_share(is_met: Callable[[float], bool]) -> float:
    """Return by bisection the greatest share c in [0, 1] that is met, as all smaller ones are."""
    if is_met(1.0):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if is_met(middle):
            low = middle
        else:
            high = middle
    return low


def share(settings: RowSettings, brakes: float) -> float:
    """Return the greatest c in [0, 1] with which the robot can brake what c·α₁ requests.

    It is 1 where α₁ requests more the faster the robot is: there it depends on the scene.

    Args:
        settings: α₁, α₂ and the hold.
        brakes: the deceleration that the robot can do [m/s²], of which `RESERVE` is left.
    """
    alpha1, able = settings.alpha1, (1.0 - RESERVE) * brakes
    if np.isinf(alpha1.hardest_speed):
        return 1.0
    return greatest_share(lambda c: requested(replace(settings, alpha1=alpha1.scaled(c))) <= able)


def stoppable(alpha1: ClassK, input_set: InputSet) -> float:
    """Return the greatest speed [m/s] from which U stops the robot where regions close in.

    It is 2 r/α₁'(0), where r is the radius of U less `RESERVE`; `docs/rows.md` derives it. The
    steeper α₁ is at 0, the closer to a region the robot still drives at that speed.
    """
    return 2.0 * (1.0 - RESERVE) * weakest(input_set) / alpha1.derivative(0.0)


def speed_left(v_max: object, margin: Any) -> Any:
    """Return ``√(v_max² − 2 v_max · margin)``, the speed that caps v_max leave [m/s]."""
    return np.sqrt(np.maximum(0.0, v_max * (v_max - 2.0 * margin)))


def check_limits(
    scenes: BarrierSet,
    period: float | None,
    u_max: float,
    speed_margin: float = 0.0,
    turn: float = 0.0,
) -> None:
    """Refuse speed limits and speed zones that no input can satisfy.

    Args:
        scenes: the scenes of N plants.
        period: how long an input is held [s]; None where that is not known.
        u_max: the largest norm of an input [m/s²].
        speed_margin: what the rows of speed limits reserve besides their own margins [m/s].
        turn: the greatest turning rate of a differential drive [rad/s]; 0 for all others.

    Raises:
        InvalidInputError: if a margin leaves nothing of a speed limit, or a held input can pass
            it from rest within one period.
    """
    is_cap = scenes.kind == layout.SPEED_LIMIT
    v_max = scenes.parameters[is_cap, layout.V_MAX]
    margin = scenes.own_margin[is_cap] + speed_margin
    if len(v_max):
        worst = int(np.argmin(v_max - 2.0 * margin))
        speed_limit.check_leaves_speed("speed limit", v_max[worst], margin[worst])
    if period is None:
        return
    zone_limits = scenes.parameters[scenes.kind == layout.ZONES, layout.V_MAX]
    lowest = speed_limit.least_limit(period, u_max, speed_margin, turn)
    if (zone_limits < lowest).any():
        raise InvalidInputError(
            f"speed zone: got {zone_limits.min():g} m/s, expected at least {lowest:g} m/s: its row "
            f"reserves {speed_margin:g} m/s, and an input passes the rest within one period"
        )
    gained = u_max * period
    left = speed_left(v_max, margin).min(initial=np.inf)
    if left <= gained:
        raise InvalidInputError(
            f"speed limit: got {left:g} m/s after its margin, expected above {gained:g} m/s, "
            "which an input reaches within one period: sample faster or allow smaller inputs"
        )
