"""Measures of a rollout that several tables and infos share."""

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.models.constants import ASKING, STANDING


def deadlocked(velocity: Array, u_nominal: Array, distance: Array, radius: float) -> Mask:
    """Return when the robot stands, away from its goal, though the policy requests motion.

    ``‖v‖ < 0.05 m/s, ‖u*‖ > 0.3 m/s², distance > radius``.

    Args:
        velocity: (…, 2) [m/s].
        u_nominal: (…, 2) u* [m/s²].
        distance: (…) from the goal [m].
        radius: within which the goal counts as reached [m].
    """
    stands = np.linalg.norm(velocity, axis=-1) < STANDING
    asks = np.linalg.norm(u_nominal, axis=-1) > ASKING
    return stands & asks & (distance > radius)
