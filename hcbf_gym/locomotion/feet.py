"""The feet's plan: footholds and swings put together, one tick ahead."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.locomotion.body_reference import BodyReference
from hcbf_gym.locomotion.foothold import foothold
from hcbf_gym.locomotion.gait import FootPhases, Gait
from hcbf_gym.locomotion.state import Array
from hcbf_gym.locomotion.swing import swing_step


class FootTargets(NamedTuple):
    """What each foot shall do, in the world.

    Attributes:
        stance: (4,) bool, feet that carry; the others follow their swing.
        motion: (4, 3, 3) per foot the rows position [m], velocity [m/s], acceleration [m/s²].
        foothold: (4, 2) where it shall land, or stands [m].
    """

    stance: NDArray[np.bool_]
    motion: Array
    foothold: Array


@njit(cache=True)
def standing(feet: Array) -> FootTargets:
    """Return targets that leave the feet (4, 3) [m] where they stand."""
    motion = np.zeros((4, 3, 3))
    motion[:, 0] = feet
    return FootTargets(np.ones(4, dtype=np.bool_), motion, feet[:, :2].copy())


@njit(cache=True)
def plan_feet(
    previous: FootTargets,
    phases: FootPhases,
    gait: Gait,
    feet: Array,
    nominal: Array,
    position: Array,
    velocity: Array,
    yaw: float,
    reference: BodyReference,
    height: float,
    touchdown: float,
    dt: float,
) -> FootTargets:
    """Return the targets one tick later.

    Args:
        previous: the targets of the tick before.
        phases: which feet stand, and how long the others still swing.
        gait: the gait in play.
        feet: (4, 3) the feet's measured places in the world [m].
        nominal: (4, 2) footholds at rest in the trunk's axes [m].
        position: (3,) of the trunk [m].
        velocity: (3,) of the trunk in the world's axes [m/s].
        yaw: of the trunk [rad].
        reference: of the trunk.
        height: of the trunk above the ground [m].
        touchdown: height of a foot's centre on the ground [m].
        dt: tick [s].
    """
    targets = standing(feet)
    stance_time = gait.duty * gait.period
    swing_time = (1.0 - gait.duty) * gait.period
    for foot in range(4):
        if phases.stance[foot]:
            continue
        remaining = phases.remaining[foot]
        landing = foothold(
            nominal[foot],
            position,
            velocity,
            yaw,
            reference,
            remaining,
            stance_time,
            height,
        )
        now = targets.motion[foot] if previous.stance[foot] else previous.motion[foot]
        targets.stance[foot] = False
        targets.foothold[foot] = landing
        targets.motion[foot] = swing_step(now, landing, touchdown, remaining, swing_time, dt)
    return targets
