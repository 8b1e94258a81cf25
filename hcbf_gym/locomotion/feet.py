"""The feet's plan: footholds and swings put together, one tick ahead."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.locomotion.body_reference import BodyReference
from hcbf_gym.locomotion.foothold import foothold
from hcbf_gym.locomotion.gait import FootPhases, Gait
from hcbf_gym.locomotion.state import Array
from hcbf_gym.locomotion.swing import swing_foot


class FootTargets(NamedTuple):
    """What each foot shall do, in the world.

    Attributes:
        stance: (4,) bool, feet that carry; the others follow their swing.
        motion: (4, 3, 3) per foot position [m], velocity [m/s] and acceleration [m/s²].
        lift_off: (4,) height where the foot last stood [m].
        foothold: (4, 2) where it shall land, or stands [m].
    """

    stance: NDArray[np.bool_]
    motion: Array
    lift_off: Array
    foothold: Array


@njit(cache=True)
def standing(feet: Array) -> FootTargets:
    """Return targets that leave the feet (4, 3) [m] where they stand."""
    motion = np.zeros((4, 3, 3))
    motion[:, 0] = feet
    return FootTargets(np.ones(4, dtype=np.bool_), motion, feet[:, 2].copy(), feet[:, :2].copy())


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
        phases: which feet stand, and how far the others' swings are.
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
        targets.stance[foot] = False
        landing = foothold(
            nominal[foot],
            position,
            velocity,
            yaw,
            reference,
            phases.remaining[foot],
            stance_time,
            height,
        )
        now = targets.motion[foot] if previous.stance[foot] else previous.motion[foot]
        if not previous.stance[foot]:
            targets.lift_off[foot] = previous.lift_off[foot]
        targets.foothold[foot] = landing
        targets.motion[foot] = swing_foot(
            now,
            landing,
            targets.lift_off[foot],
            touchdown,
            phases.progress[foot],
            phases.remaining[foot],
            swing_time,
            dt,
        )
    return targets
