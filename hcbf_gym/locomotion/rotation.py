"""Rotations as the compiled kernels need them."""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel


@kernel()
def rotation_matrix(quaternion: Array) -> Array:
    """Return (3, 3) the rotation body → world of a unit quaternion (4,), w first."""
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    R = np.empty((3, 3))
    R[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    R[0, 1] = 2.0 * (x * y - w * z)
    R[0, 2] = 2.0 * (x * z + w * y)
    R[1, 0] = 2.0 * (x * y + w * z)
    R[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    R[1, 2] = 2.0 * (y * z - w * x)
    R[2, 0] = 2.0 * (x * z - w * y)
    R[2, 1] = 2.0 * (y * z + w * x)
    R[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return R


@kernel()
def yaw_of(R: Array) -> float:
    """Return the heading [rad] of a rotation body → world."""
    return np.arctan2(R[1, 0], R[0, 0])


@kernel()
def rotation_vector_to_yaw(R: Array, yaw: float) -> Array:
    """Return (3,) log(Rᵀ R_z(yaw)): the turn, in body axes, that levels the body at `yaw`."""
    c, s = np.cos(yaw), np.sin(yaw)
    E = np.empty((3, 3))  # Rᵀ R_z
    for i in range(3):
        E[i, 0] = R[0, i] * c + R[1, i] * s
        E[i, 1] = -R[0, i] * s + R[1, i] * c
        E[i, 2] = R[2, i]
    axis = np.empty(3)  # times twice the sine of the angle
    axis[0] = E[2, 1] - E[1, 2]
    axis[1] = E[0, 2] - E[2, 0]
    axis[2] = E[1, 0] - E[0, 1]
    sine = 0.5 * np.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    angle = np.arctan2(sine, 0.5 * (E[0, 0] + E[1, 1] + E[2, 2] - 1.0))
    return axis * (0.5 if sine < 1e-9 else 0.5 * angle / sine)


@kernel()
def turned(quaternion: Array, rotation: Array) -> Array:
    """Return (4,) an orientation turned by a small `rotation` (3,) about the world's axes [rad]."""
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    a, b, c = 0.5 * rotation[0], 0.5 * rotation[1], 0.5 * rotation[2]
    result = np.empty(4)
    result[0] = w - a * x - b * y - c * z
    result[1] = x + a * w + b * z - c * y
    result[2] = y + b * w + c * x - a * z
    result[3] = z + c * w + a * y - b * x
    return result / np.sqrt((result**2).sum())


@kernel()
def wrap_angle(angle: float) -> float:
    """Return the equal angle in [−π, π)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
