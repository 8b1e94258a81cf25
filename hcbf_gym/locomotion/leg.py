"""Kinematics of an abad–hip–knee leg in the trunk's axes, in closed form."""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel
from hcbf_gym.locomotion.matrices import add_cross
from hcbf_gym.locomotion.rotation import wrap_angle


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


# the same fields as one record, which compiled code reads
LEGS = np.dtype(
    (np.record, [("hip", "f8", (4, 3)), ("offset", "f8", 4), ("thigh", "f8"), ("calf", "f8")])
)


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


@kernel()
def foot_kinematics(geometry: LegGeometry, joints: Array, velocity: Array) -> FootKinematics:
    """Return the feet's positions, Jacobians and J̇q̇ for joints (12,) and velocities (12,)."""
    position = np.empty((4, 3))
    jacobian = np.empty((4, 3, 3))
    bias = np.empty((4, 3))
    l2, l3 = geometry.thigh, geometry.calf
    for leg in range(4):
        a, h, k = joints[3 * leg], joints[3 * leg + 1], joints[3 * leg + 2]
        da, dh = velocity[3 * leg], velocity[3 * leg + 1]
        dhk = dh + velocity[3 * leg + 2]
        sa, ca = np.sin(a), np.cos(a)
        s1, c1, s12, c12 = np.sin(h), np.cos(h), np.sin(h + k), np.cos(h + k)

        # the leg's plane: x forwards, d sideways, z upwards, before the abad joint turns it
        x = -l2 * s1 - l3 * s12
        d = geometry.offset[leg]
        z = -l2 * c1 - l3 * c12
        position[leg, 0] = geometry.hip[leg, 0] + x
        position[leg, 1] = geometry.hip[leg, 1] + d * ca - z * sa
        position[leg, 2] = geometry.hip[leg, 2] + d * sa + z * ca

        jacobian[leg, 0, 0] = 0.0
        jacobian[leg, 1, 0] = -d * sa - z * ca
        jacobian[leg, 2, 0] = d * ca - z * sa
        jacobian[leg, 0, 1] = z
        jacobian[leg, 1, 1] = x * sa
        jacobian[leg, 2, 1] = -x * ca
        jacobian[leg, 0, 2] = -l3 * c12
        jacobian[leg, 1, 2] = -l3 * s12 * sa
        jacobian[leg, 2, 2] = l3 * s12 * ca

        dz = l2 * s1 * dh + l3 * s12 * dhk
        ddy = -(da**2) * d - 2.0 * da * dz
        ddz = l2 * c1 * dh**2 + l3 * c12 * dhk**2 - da**2 * z
        bias[leg, 0] = l2 * s1 * dh**2 + l3 * s12 * dhk**2
        bias[leg, 1] = ddy * ca - ddz * sa
        bias[leg, 2] = ddy * sa + ddz * ca
    return FootKinematics(position, jacobian, bias)


@kernel()
def foot_bias(v: Array, r: Array, J: Array, bias: Array, joint_velocity: Array) -> Array:
    """Return (3,) a foot's acceleration, in the trunk's axes, when all generalised ones are zero.

    ``ω×v + ω×(ω×r) + 2 ω×(J q̇) + J̇ q̇`` with (v, ω) the trunk's velocity in its own axes: with
    J_c the foot's Jacobian in the world's axes this is ``Rᵀ J̇_c q̇``.
    """
    omega = v[3:6]
    carried = np.empty(3)
    acceleration = np.empty(3)
    for i in range(3):
        acceleration[i] = bias[i]
        carried[i] = v[i]
        for k in range(3):
            carried[i] += 2.0 * J[i, k] * joint_velocity[k]
    add_cross(carried, omega, r)
    add_cross(acceleration, omega, carried)
    return acceleration


@kernel()
def inverse_kinematics(geometry: LegGeometry, leg: int, foot: Array) -> Array:
    """Return (3,) the joints that bring the foot to `foot` (3,), knee backwards [rad].

    A target beyond the leg's reach is answered with the leg stretched towards it.
    """
    l2, l3 = geometry.thigh, geometry.calf
    d = geometry.offset[leg]
    x = foot[0] - geometry.hip[leg, 0]
    y = foot[1] - geometry.hip[leg, 1]
    z = foot[2] - geometry.hip[leg, 2]
    down = np.sqrt(max(y * y + z * z - d * d, 1e-6))  # depth in the leg's plane
    abad = np.arctan2(z, y) - np.arctan2(-down, d)
    cos_knee = (x * x + down * down - l2 * l2 - l3 * l3) / (2.0 * l2 * l3)
    knee = -np.arccos(min(max(cos_knee, -1.0), 1.0))
    hip = np.arctan2(-x, down) - np.arctan2(l3 * np.sin(knee), l2 + l3 * np.cos(knee))
    joints = np.empty(3)
    joints[0] = wrap_angle(abad)
    joints[1] = hip
    joints[2] = knee
    return joints
