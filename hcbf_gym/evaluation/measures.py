"""The measure of a deadlock, which tables of episodes and the environments' infos share."""

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.models.constants import ASKING, STANDING


def deadlocked(velocity: Array, u_nominal: Array, distance: Array, radius: float) -> Mask:
    """Return (…) whether the robot is at rest, away from its goal, though u* requests motion.

    ``‖v‖ < 0.05 m/s, ‖u*‖ > 0.3 m/s², distance > radius``.

    Args:
        velocity: (…, 2) [m/s].
        u_nominal: (…, 2) u* [m/s²].
        distance: (…) the distance from the goal [m].
        radius: the distance within which the goal counts as reached [m].
    """
    is_at_rest = np.linalg.norm(velocity, axis=-1) < STANDING
    requests_motion = np.linalg.norm(u_nominal, axis=-1) > ASKING
    return is_at_rest & requests_motion & (distance > radius)
