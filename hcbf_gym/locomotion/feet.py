"""The feet's plan: footholds and swings put together, one tick ahead."""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.compilation import kernel
from hcbf_gym.locomotion.body_reference import BodyReference
from hcbf_gym.locomotion.foothold import Trunk, foothold
from hcbf_gym.locomotion.gait import FootPhases, Gait
from hcbf_gym.locomotion.swing import swing_step

# last share of the swing in which the foothold is held: it sways with the trunk's velocity, and a
# foot that chases it to the end lands at up to 1 m/s along the ground and slides
SETTLED = 0.3


class FootTargets(NamedTuple):
    """What each foot shall do, in the world.

    Attributes:
        stance: (4,) bool, feet that carry; the others follow their swing.
        motion: (4, 3, 3) per foot the rows position [m], velocity [m/s], acceleration [m/s²].
        foothold: (4, 2) where it shall land, or stands [m].
    """

    stance: Mask
    motion: Array
    foothold: Array


# the same fields as one record, which compiled code updates in place
TARGETS = np.dtype(
    (np.record, [("stance", "u1", 4), ("motion", "f8", (4, 3, 3)), ("foothold", "f8", (4, 2))])
)


@kernel()
def stand(targets: FootTargets, foot: int, place: Array) -> None:
    """Let a foot carry where it is, at `place` (3,) [m]."""
    targets.stance[foot] = 1
    targets.motion[foot, 0] = place
    targets.motion[foot, 1:] = 0.0
    targets.foothold[foot] = place[:2]


class Places(NamedTuple):
    """Where feet are and belong.

    Attributes:
        measured: (4, 3) in the world [m].
        nominal: (4, 2) footholds at rest in the trunk's axes [m].
        touchdown: height of a foot's centre on the ground [m].
    """

    measured: Array
    nominal: Array
    touchdown: float


@kernel()
def plan_feet(
    targets: FootTargets,
    phases: FootPhases,
    gait: Gait,
    places: Places,
    trunk: Trunk,
    reference: BodyReference,
    dt: float,
) -> None:
    """Move the targets on by one tick.

    Args:
        targets: a `TARGETS` record, changed in place.
        phases: which feet stand, and how long the others still swing.
        gait: the gait in play.
        places: of the feet.
        trunk: as measured.
        reference: of the trunk.
        dt: tick [s].
    """
    stance_time = gait.duty * gait.period
    swing_time = (1.0 - gait.duty) * gait.period
    for foot in range(4):
        if phases.stance[foot]:
            stand(targets, foot, places.measured[foot])
            continue
        remaining = phases.remaining[foot]
        if remaining > SETTLED * swing_time:
            targets.foothold[foot] = foothold(
                places.nominal[foot], trunk, reference, remaining, stance_time
            )
        targets.stance[foot] = 0
        targets.motion[foot] = swing_step(
            targets.motion[foot],
            targets.foothold[foot],
            places.touchdown,
            remaining,
            swing_time,
            dt,
        )
