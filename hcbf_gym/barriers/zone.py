r"""Speed limits by place: the robot brakes before it enters a zone.

With d⁺ the distance to the nearest cell of the zone, 0 inside, L the limit there and β a
deceleration that every robot here can do,

.. math:: h = (L² + 2 β d^+ - ‖v‖²) / (2 L),

in m/s as a speed limit's. Its zero is the speed from which braking by β reaches L at the edge.
`docs/rows.md` derives the row of an input that is held.
"""

import numpy as np

from hcbf_gym import _core

BRAKING = _core.ZONE_BRAKING
"""β, with which a robot slows down before a zone [m/s²]."""


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
