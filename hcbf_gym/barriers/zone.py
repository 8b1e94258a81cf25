r"""Speed limits by place: the robot brakes before it enters a zone.

With d⁺ the distance to the nearest cell of the zone, 0 inside, L the limit there and β a
deceleration that every robot here can do,

.. math:: h = (L² + 2 β d^+ - ‖v‖²) / (2 L),

in m/s as a speed limit's. Its zero is the speed from which braking by β reaches L at the edge.
`docs/rows.md` derives the row of an input that is held.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import class_k
from hcbf_gym.barriers.rows import ALPHA2, HELD, PERIOD, U_MAX
from hcbf_gym.compilation import kernel

BRAKING = 1.0
"""β, with which a robot slows down before a zone [m/s²]."""


@kernel(error_model="numpy", inline="always")
def value(limit: float, away: float, vx: float, vy: float) -> float:
    """Return h at the distance d⁺ = `away` [m] and the velocity (vx, vy)."""
    return (limit * limit + 2.0 * BRAKING * away - vx * vx - vy * vy) / (2.0 * limit)


@kernel(error_model="numpy")
def row(
    kept: float,
    margin_rate: float,
    closing: float,
    vx: float,
    vy: float,
    limit: float,
    s: Array,
    hardest: float,
) -> tuple[float, float, float]:
    """Return b, α₂(ψ) and ψ = h − m of a zone's row, whose gradient is −v/L.

    Args:
        kept: h − m [m/s].
        margin_rate: ṁ [m/s²].
        closing: d/dt of d⁺, not positive while the robot comes nearer [m/s].
        vx: velocity [m/s].
        vy: likewise.
        limit: L [m/s].
        s: (15,) `RowSettings.packed`; its u_max changes the speed.
        hardest: the greatest acceleration of the position [m/s²]; more than u_max where the
            velocity turns by itself.
    """
    alpha2_psi = class_k.value(s[ALPHA2 : ALPHA2 + 4], kept)
    b = -alpha2_psi
    drift = BRAKING * closing / limit
    if s[HELD] == 0.0:
        return b - drift + margin_rate, alpha2_psi, kept
    period = s[PERIOD]
    strays = BRAKING * (hardest - s[U_MAX])
    cost = ((s[U_MAX] + BRAKING) * s[U_MAX] + strays) * period / (2.0 * limit)
    b = max(b, cost - kept / period) if kept >= 0.0 else b + cost
    stop = (vx * vx + vy * vy) / (limit * period)  # a full stop gives no more
    return min(b - drift, stop) + margin_rate, alpha2_psi, kept


@kernel(error_model="numpy")
def reach(limit: float, margin: float, fastest: float) -> float:
    """Return the distance from which a robot has to brake for a zone [m].

    Args:
        limit: L [m/s].
        margin: m [m/s].
        fastest: its greatest speed meanwhile [m/s].
    """
    return max(0.0, fastest * fastest - limit * (limit - 2.0 * margin)) / (2.0 * BRAKING)


def least_limit(period: float, u_max: float, margin: float, turn: float = 0.0) -> float:
    """Return the lowest limit that a held input can satisfy after its margin [m/s].

    It solves ``L² − 2 m L = (β² (1 + ΩT/2)² + β u (1 + ΩT) + u²) T²``; see `docs/rows.md`.

    Args:
        period: T [s].
        u_max: u, the greatest change of the speed [m/s²].
        margin: m [m/s].
        turn: Ω, by how much the velocity turns besides, that of a differential drive [rad/s].
    """
    turned = turn * period
    squared = (BRAKING * (1.0 + 0.5 * turned)) ** 2 + BRAKING * u_max * (1.0 + turned) + u_max**2
    gained = period * np.sqrt(squared)
    return float(margin + np.hypot(margin, gained))
