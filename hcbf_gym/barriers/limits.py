"""Whether inputs can satisfy the speed limits and speed zones of scenes."""

import numpy as np

from hcbf_gym.barriers import layout, zone
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.speed_limit import check_leaves_speed
from hcbf_gym.errors import InvalidInputError


def check_limits(
    scenes: BarrierSet,
    hold: tuple[float | None, float],
    speed_margin: float = 0.0,
    turn: float = 0.0,
) -> None:
    """Refuse speed limits and speed zones that no input can satisfy.

    Args:
        scenes: of the plants.
        hold: how long an input is held [s], None where that is not known, and the largest norm
            of an input [m/s²].
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
        check_leaves_speed("speed limit", v_max[worst], margin[worst])
    period, u_max = hold
    if period is None:
        return
    zones = scenes.kind == layout.ZONES
    limit = scenes.parameters[zones, layout.V_MAX]
    lowest = zone.least_limit(period, u_max, speed_margin, turn)
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
