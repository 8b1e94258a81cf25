"""The task-space QP with everything that the equalities fix taken out: twelve unknowns remain.

Each leg brings three: its contact force F_i if it stands, its joint accelerations q̈_i if it swings.
A standing foot does not move, ``B_i a + J_i q̈_i + β_i = 0`` with a the trunk's acceleration and
``B_i = [1, −r_i×]``, which gives q̈_i through a 3×3 inverse. The trunk's six rows of the dynamics
then give a, the legs' rows give τ, all affine in the unknowns z.

`task_space.py` holds the same program in the paper's form; both give the same torques.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.locomotion.leg import FootKinematics, inverse_3x3
from hcbf_gym.locomotion.rotation import cross, skew
from hcbf_gym.locomotion.state import Array
from hcbf_gym.locomotion.tasks import HEIGHT_WEIGHT, TaskAccelerations

FORCE_WEIGHT = 1e-4  # on ‖F‖², which decides between forces that do the same


class QuadraticProgram(NamedTuple):
    """``min ½ zᵀHz + fᵀz`` subject to ``lower ≤ [z; A z] ≤ upper``.

    Attributes:
        H: (n, n) positive definite.
        f: (n,).
        A: (m, n) general rows.
        lower: (n + m,) bounds, of the unknowns first.
        upper: (n + m,).
    """

    H: Array
    f: Array
    A: Array
    lower: Array
    upper: Array


@njit(cache=True)
def foot_bias(v: Array, r: Array, jacobian: Array, bias: Array, joint_velocity: Array) -> Array:
    """Return (3,) β, a foot's acceleration in the trunk's axes when all generalised ones are zero.

    ``β = ω×v + ω×(ω×r) + 2 ω×(J q̇) + J̇ q̇``; v (18,) is the generalised velocity in the trunk's
    axes, r (3,) the foot.
    """
    omega = v[3:6]
    slide = jacobian @ joint_velocity
    return cross(omega, v[:3] + cross(omega, r) + 2.0 * slide) + bias


@njit(cache=True)
def condense(
    M: Array,
    h: Array,
    v: Array,
    R: Array,
    feet: FootKinematics,
    stance: NDArray[np.bool_],
    tasks: TaskAccelerations,
    friction: float,
    torque_limit: float,
) -> tuple[QuadraticProgram, Array]:
    """Return the program in z (12,) and the offset p (12,) of ``τ = A[:12] z + p``.

    Args:
        M: (18, 18) mass matrix, upper triangle.
        h: (18,) bias forces.
        v: (18,) generalised velocity.
        R: (3, 3) trunk → world.
        feet: the feet's kinematics in the trunk's axes.
        stance: (4,) bool.
        tasks: the accelerations to come close to.
        friction: µ of the pyramid ``|F_x|, |F_y| ≤ µ F_z``.
        torque_limit: on every joint [N·m].
    """
    # trunk: S a = G z + g
    S = np.empty((6, 6))
    for i in range(6):
        for j in range(i, 6):
            S[i, j] = M[i, j]
            S[j, i] = M[i, j]
    G = np.zeros((6, 12))
    g = -h[:6].copy()
    # legs in stance: q̈_i = −J⁻¹(B_i a + β_i); in swing q̈_i = z_i
    beta = np.empty((4, 3))
    lever = np.zeros((4, 3, 6))  # −J⁻¹B
    rest = np.zeros((4, 3))  # −J⁻¹β
    for foot in range(4):
        k = slice(3 * foot, 3 * foot + 3)
        joints = slice(6 + 3 * foot, 9 + 3 * foot)
        r, J = feet.position[foot], feet.jacobian[foot]
        beta[foot] = foot_bias(v, r, J, feet.bias[foot], v[joints])
        coupling = np.ascontiguousarray(M[:6, joints])
        if stance[foot]:
            J_inverse = inverse_3x3(J)
            lever[foot, :, :3] = -J_inverse
            lever[foot, :, 3:] = J_inverse @ skew(r)
            rest[foot] = -J_inverse @ beta[foot]
            S += coupling @ lever[foot]
            g -= coupling @ rest[foot]
            G[:3, k] = R.T
            G[3:, k] = skew(r) @ R.T
        else:
            G[:, k] = -coupling
    right = np.empty((6, 13))
    right[:, :12] = G
    right[:, 12] = g
    solved = np.linalg.solve(S, right)
    E = np.ascontiguousarray(solved[:, :12])  # a = E z + e
    e = np.ascontiguousarray(solved[:, 12])

    # tasks: rows T z ≈ t, weighted
    T = np.zeros((18, 12))
    t = np.zeros(18)
    T[:3] = R @ E[:3]
    t[:3] = tasks.linear - R @ (e[:3] + cross(v[3:6], v[:3]))
    T[3:6] = E[3:]
    t[3:6] = tasks.angular - e[3:]
    T[2] *= np.sqrt(HEIGHT_WEIGHT)
    t[2] *= np.sqrt(HEIGHT_WEIGHT)

    standing = 0
    for foot in range(4):
        standing += stance[foot]
    A = np.zeros((12 + 4 * standing, 12))
    p = np.empty(12)
    lower = np.full(24 + 4 * standing, -np.inf)
    upper = np.full(24 + 4 * standing, np.inf)
    H = np.zeros((12, 12))
    row = 12
    for foot in range(4):
        k = slice(3 * foot, 3 * foot + 3)
        joints = slice(6 + 3 * foot, 9 + 3 * foot)
        J = feet.jacobian[foot]
        coupling = np.ascontiguousarray(M[:6, joints].T)
        own = np.empty((3, 3))
        for i in range(3):
            for j in range(i, 3):
                own[i, j] = M[6 + 3 * foot + i, 6 + 3 * foot + j]
                own[j, i] = own[i, j]
        if stance[foot]:
            carried = coupling + own @ lever[foot]
            A[k] = carried @ E
            A[k, k] -= J.T @ R.T
            p[k] = carried @ e + own @ rest[foot] + h[joints]
            x, y, z = 3 * foot, 3 * foot + 1, 3 * foot + 2
            lower[z] = 0.0
            for axis in (x, y):
                A[row, axis], A[row, z], upper[12 + row] = 1.0, -friction, 0.0
                A[row + 1, axis], A[row + 1, z], lower[12 + row + 1] = 1.0, friction, 0.0
                row += 2
            for i in (x, y, z):
                H[i, i] = FORCE_WEIGHT
        else:
            A[k] = coupling @ E
            A[k, k] += own
            p[k] = coupling @ e + h[joints]
            B = np.zeros((3, 6))
            B[0, 0] = B[1, 1] = B[2, 2] = 1.0
            B[:, 3:] = -skew(feet.position[foot])
            i = 6 + 3 * foot
            T[i : i + 3] = R @ B @ E
            T[i : i + 3, k] += R @ J
            t[i : i + 3] = tasks.feet[foot] - R @ (B @ e + beta[foot])
    lower[12:24] = -torque_limit - p
    upper[12:24] = torque_limit - p
    H += T.T @ T
    return QuadraticProgram(H, -(T.T @ t), A, lower, upper), p
