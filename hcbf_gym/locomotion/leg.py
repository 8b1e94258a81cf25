"""Kinematics of an abad–hip–knee leg in the trunk's axes, in closed form."""

from typing import NamedTuple

from hcbf_gym import _core
from hcbf_gym.arrays import Array, packed
from hcbf_gym.locomotion.records import LEGS


class LegGeometry(NamedTuple):
    """Lengths of the four legs."""

    hip: Array  # (4, 3) abad joint in the trunk's axes [m]
    offset: Array  # (4,) from the abad axis sideways to the leg's plane, left positive [m]
    thigh: float  # hip to knee [m]
    calf: float  # knee to the foot's centre [m]


class FootKinematics(NamedTuple):
    """Motion of the feet's centres in the trunk's axes."""

    position: Array  # (4, 3) r from the trunk's origin [m]
    jacobian: Array  # (4, 3, 3) J = ∂r/∂q of the leg's own joints
    bias: Array  # (4, 3) J̇q̇ [m/s²]


def foot_kinematics(geometry: LegGeometry, joints: Array, velocity: Array) -> FootKinematics:
    """Return the feet's positions, Jacobians and J̇q̇ for joints (12,) and velocities (12,)."""
    return FootKinematics._make(_core.foot_kinematics(packed(geometry, LEGS), joints, velocity))
