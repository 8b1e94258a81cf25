"""The task-space QP with everything that the equalities fix taken out: twelve unknowns remain.

Each leg brings three: its contact force F_i if it stands, its joint accelerations q̈_i if it swings.
A standing foot does not move, ``B_i a + J_i q̈_i + β_i = 0`` with a the trunk's acceleration and
``B_i = [1, −r_i×]``, which gives q̈_i through a 3×3 inverse. The trunk's six rows of the dynamics
then give a, and the legs' rows τ: all affine in the unknowns z.

`task_space.py` poses the same program in the paper's form; both give the same torques.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.locomotion.leg import FootKinematics, inverse_3x3
from hcbf_gym.locomotion.rotation import cross, skew
from hcbf_gym.locomotion.state import Array
from hcbf_gym.locomotion.task_space import (
    FORCE_WEIGHT,
    QuadraticProgram,
    TaskSpaceProgram,
    foot_bias,
)
from hcbf_gym.locomotion.tasks import HEIGHT_WEIGHT, TaskAccelerations


@njit(cache=True)
def symmetric_block(M: Array, start: int, size: int) -> Array:
    """Return (size, size) the diagonal block at `start` of a matrix known by its upper triangle."""
    block = np.empty((size, size))
    for i in range(size):
        for j in range(i, size):
            block[i, j] = M[start + i, start + j]
            block[j, i] = block[i, j]
    return block


@njit(cache=True)
def trunk_acceleration(
    M: Array,
    bias: Array,
    R: Array,
    feet: FootKinematics,
    stance: NDArray[np.bool_],
    lever: Array,
    rest: Array,
) -> Array:
    """Return (6, 13) [E | e] with ``a = E z + e``, the trunk's rows solved for a.

    Args:
        M: (18, 18) mass matrix, upper triangle.
        bias: (18,) forces.
        R: (3, 3) trunk → world.
        feet: the feet's kinematics in the trunk's axes.
        stance: (4,) bool.
        lever: (4, 3, 6) ``−J⁻¹B`` of standing legs.
        rest: (4, 3) ``−J⁻¹β`` of standing legs.
    """
    inertia = symmetric_block(M, 0, 6)
    right = np.zeros((6, 13))
    right[:, 12] = -bias[:6]
    for foot in range(4):
        k = slice(3 * foot, 3 * foot + 3)
        coupling = np.ascontiguousarray(M[:6, 6 + 3 * foot : 9 + 3 * foot])
        if stance[foot]:
            inertia += coupling @ lever[foot]
            right[:, 12] -= coupling @ rest[foot]
            right[:3, k] = R.T
            right[3:, k] = skew(feet.position[foot]) @ R.T
        else:
            right[:, k] = -coupling
    return np.asarray(np.linalg.solve(inertia, right))


@njit(cache=True)
def condense(
    M: Array,
    bias: Array,
    v: Array,
    R: Array,
    feet: FootKinematics,
    stance: NDArray[np.bool_],
    tasks: TaskAccelerations,
    friction: float,
    torque_limit: float,
) -> TaskSpaceProgram:
    """Return the program in z (12,); arguments as in `task_space.full_form`."""
    beta = np.empty((4, 3))
    lever = np.zeros((4, 3, 6))
    rest = np.zeros((4, 3))
    contacts = 0
    for foot in range(4):
        r, J = feet.position[foot], feet.jacobian[foot]
        beta[foot] = foot_bias(v, r, J, feet.bias[foot], v[6 + 3 * foot : 9 + 3 * foot])
        if stance[foot]:
            contacts += 1
            J_inverse = inverse_3x3(J)
            lever[foot, :, :3] = -J_inverse
            lever[foot, :, 3:] = J_inverse @ skew(r)
            rest[foot] = -(J_inverse @ beta[foot])

    affine = trunk_acceleration(M, bias, R, feet, stance, lever, rest)
    E, e = np.ascontiguousarray(affine[:, :12]), affine[:, 12].copy()

    T = np.zeros((18, 12))  # task rows T z ≈ t
    t = np.zeros(18)
    T[:3] = R @ E[:3]
    t[:3] = tasks.linear - R @ (e[:3] + cross(v[3:6], v[:3]))
    T[3:6] = E[3:]
    t[3:6] = tasks.angular - e[3:]
    T[2] *= np.sqrt(HEIGHT_WEIGHT)
    t[2] *= np.sqrt(HEIGHT_WEIGHT)

    H = np.zeros((12, 12))
    A = np.zeros((12 + 4 * contacts, 12))  # the first rows are the torques
    offset = np.empty(12)
    lower = np.full(24 + 4 * contacts, -np.inf)
    upper = np.full(24 + 4 * contacts, np.inf)
    row = 12
    for foot in range(4):
        x, z = 3 * foot, 3 * foot + 2
        k, joints = slice(x, x + 3), slice(6 + x, 9 + x)
        J = feet.jacobian[foot]
        coupling = np.ascontiguousarray(M[:6, joints]).T
        own = symmetric_block(M, 6 + x, 3)
        if stance[foot]:
            carried = coupling + own @ lever[foot]
            A[k] = carried @ E
            A[k, k] -= (R @ J).T
            offset[k] = carried @ e + own @ rest[foot] + bias[joints]
            lower[z] = 0.0
            for axis in range(x, z):
                for sign in (-1.0, 1.0):
                    A[row, axis] = sign
                    A[row, z] = friction
                    lower[12 + row] = 0.0
                    row += 1
            for i in range(x, x + 3):
                H[i, i] = FORCE_WEIGHT
        else:
            A[k] = coupling @ E
            A[k, k] += own
            offset[k] = coupling @ e + bias[joints]
            moved = E[:3] - skew(feet.position[foot]) @ E[3:]
            drift = e[:3] + cross(e[3:], feet.position[foot]) + beta[foot]
            T[joints] = R @ moved
            T[joints, k] += R @ J
            t[joints] = tasks.feet[foot] - R @ drift
    lower[12:24] = -torque_limit - offset
    upper[12:24] = torque_limit - offset
    H += T.T @ T
    program = QuadraticProgram(H, -(T.T @ t), A, lower, upper, 0)
    return TaskSpaceProgram(program, A[:12], offset)
