"""Kinematics of an abad–hip–knee leg in the trunk's axes, in closed form."""

from typing import NamedTuple

from hcbf_gym import _core
from hcbf_gym.arrays import Array, packed
from hcbf_gym.locomotion.records import LEGS


class LegGeometry(NamedTuple):
    """Lengths of the four legs.

    Attributes:
        hip: (4, 3) abad joint in the trunk's axes [m].
        offset: (4,) from the abad axis sideways to the leg's plane, left positive [m].
        thigh: hip to knee [m].
        calf: knee to the foot's centre [m].
    """

    hip: Array
    offset: Array
    thigh: float
    calf: float


class FootKinematics(NamedTuple):
    """Where the feet are and how the joints move them, in the trunk's axes.

    Attributes:
        position: (4, 3) r, of the foot's centre from the trunk's origin [m].
        jacobian: (4, 3, 3) J = ∂r/∂q of the leg's own joints.
        bias: (4, 3) J̇q̇ [m/s²].
    """

    position: Array
    jacobian: Array
    bias: Array


def foot_kinematics(geometry: LegGeometry, joints: Array, velocity: Array) -> FootKinematics:
    """Return the feet's positions, Jacobians and J̇q̇ for joints (12,) and velocities (12,)."""
    return FootKinematics._make(_core.foot_kinematics(packed(geometry, LEGS), joints, velocity))
