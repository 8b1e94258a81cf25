"""The task-space QP with everything that the equalities fix taken out: twelve unknowns remain.

Each leg brings three: its contact force F_i if it stands, its joint accelerations q̈_i if it swings.
A standing foot does not move, ``B_i a + J_i q̈_i + β_i = 0`` with a the trunk's acceleration and
``B_i = [1, −r_i×]``, which gives q̈_i through a 3×3 inverse; the trunk's six rows of the dynamics
then give a, and the legs' rows τ. So everything is affine in the unknowns z and kept as a matrix
with 13 columns, ``· [z; 1]``.

`task_space.py` poses the same program in the paper's form; both give the same torques.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.locomotion.leg import FootKinematics
from hcbf_gym.locomotion.matrices import (
    add_cross,
    apply,
    apply_transposed,
    cross,
    inverse_3x3,
    solve_in_place,
)
from hcbf_gym.locomotion.state import Array
from hcbf_gym.locomotion.task_space import FORCE_WEIGHT, foot_bias
from hcbf_gym.locomotion.tasks import HEIGHT_WEIGHT, TaskAccelerations

# a program and what comes of it, as one record that compiled code fills in: of A and the bounds the
# rows for four standing feet, of which those of the feet that stand count
WORKSPACE = np.dtype(
    (
        np.record,
        [
            ("H", "f8", (12, 12)),
            ("f", "f8", 12),
            ("A", "f8", (28, 12)),  # the first 12 rows are the torques
            ("lower", "f8", 40),
            ("upper", "f8", 40),
            ("torque_offset", "f8", 12),  # τ = A[:12] z + torque_offset [N·m]
            ("z", "f8", 12),
            ("feedforward", "f8", 12),  # τ of the latest solution [N·m]
            ("feedback", "f8", 12),  # of the joint impedance [N·m]
            ("limits", "f8", (2, 12)),  # least and largest torque of each joint [N·m]
            ("torque", "f8", 12),  # feedforward and feedback within the limits [N·m]
        ],
    )
)


class Accelerations(NamedTuple):
    """How the unknowns accelerate the robot.

    Attributes:
        trunk: (6, 13) the trunk's acceleration ``a = trunk [z; 1]``, in its own axes.
        lever: (4, 3, 6) and rest (4, 3) a standing leg's joints, ``q̈_i = lever_i a + rest_i``;
            those of a swinging leg are z_i.
    """

    trunk: Array
    lever: Array
    rest: Array


@njit(cache=True)
def accelerations(
    M: Array,
    bias: Array,
    R: Array,
    feet: FootKinematics,
    beta: Array,
    stance: NDArray[np.bool_],
) -> Accelerations:
    """Return q̈ as it depends on z, from the trunk's rows of the dynamics.

    Args:
        M: (18, 18) mass matrix.
        bias: (18,) forces.
        R: (3, 3) trunk → world.
        feet: the feet's kinematics in the trunk's axes.
        beta: (4, 3) the feet's accelerations, in the trunk's axes, that q̈ does not cause.
        stance: (4,) bool.
    """
    trunk, inertia = np.zeros((6, 13)), np.empty((6, 6))
    lever, rest = np.zeros((4, 3, 6)), np.zeros((4, 3))
    for i in range(6):
        trunk[i, 12] = -bias[i]
        for j in range(6):
            inertia[i, j] = M[i, j]
    for foot in range(4):
        x, joint = 3 * foot, 6 + 3 * foot
        if not stance[foot]:
            for i in range(6):
                for k in range(3):
                    trunk[i, x + k] = -M[i, joint + k]
            continue
        r, J_inverse = feet.position[foot], inverse_3x3(feet.jacobian[foot])
        for k in range(3):  # −J⁻¹B, −J⁻¹β, and the wrench of a unit of force at r
            for i in range(3):
                lever[foot, k, i] = -J_inverse[k, i]
                rest[foot, k] -= J_inverse[k, i] * beta[foot, i]
                trunk[i, x + k] = R[k, i]
            add_cross(lever[foot, k, 3:], J_inverse[k], r)
            add_cross(trunk[3:, x + k], r, R[k])
        for i in range(6):  # the leg moves with the trunk, and weighs on it
            for k in range(3):
                coupling = M[i, joint + k]
                trunk[i, 12] -= coupling * rest[foot, k]
                for j in range(6):
                    inertia[i, j] += coupling * lever[foot, k, j]
    solve_in_place(inertia, trunk)
    return Accelerations(trunk, lever, rest)


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
    limits: Array,
    out: np.record,
) -> int:
    """Fill in the program in z (12,) and return how many feet stand, c.

    Args:
        M: (18, 18) mass matrix.
        bias: (18,) forces of the dynamics.
        v: (18,) generalised velocity.
        R: (3, 3) trunk → world.
        feet: the feet's kinematics in the trunk's axes.
        stance: (4,) bool, feet that do not move.
        tasks: the accelerations to come close to.
        friction: µ of the friction pyramid.
        limits: (2, 12) least and largest torque of each joint [N·m].
        out: a `WORKSPACE` record; the rows ``A[: 12 + 4c]`` count.
    """
    beta = np.empty((4, 3))
    for foot in range(4):
        rate = v[6 + 3 * foot : 9 + 3 * foot]
        beta[foot] = foot_bias(v, feet.position[foot], feet.jacobian[foot], feet.bias[foot], rate)
    trunk, lever, rest = accelerations(M, bias, R, feet, beta, stance)

    H, f, A, lower, upper = out.H, out.f, out.A, out.lower, out.upper
    H[:] = 0.0
    f[:] = 0.0
    A[12:] = 0.0
    lower[:] = -np.inf
    upper[:] = np.inf
    torque = np.zeros((12, 13))
    error = np.zeros((18, 13))  # of the tasks: trunk linear, trunk angular, feet that swing
    errors, row = 6, 12

    drift = cross(v[3:6], v[:3])
    for i in range(3):
        weight = np.sqrt(HEIGHT_WEIGHT) if i == 2 else 1.0
        for k in range(3):
            for j in range(13):
                error[i, j] += weight * R[i, k] * trunk[k, j]
            error[i, 12] += weight * R[i, k] * drift[k]
        error[i, 12] -= weight * tasks.linear[i]
        for j in range(13):
            error[3 + i, j] = trunk[3 + i, j]
        error[3 + i, 12] -= tasks.angular[i]

    for foot in range(4):
        x, joint = 3 * foot, 6 + 3 * foot
        r, J = feet.position[foot], feet.jacobian[foot]
        for k in range(3):  # the leg's rows of the dynamics
            leg = M[joint + k]
            total = torque[x + k]
            total[12] = bias[joint + k]
            for i in range(6):
                of_trunk = leg[i]
                if stance[foot]:
                    for n in range(3):
                        of_trunk += leg[joint + n] * lever[foot, n, i]
                for j in range(13):
                    total[j] += of_trunk * trunk[i, j]
            for n in range(3):
                if stance[foot]:
                    total[12] += leg[joint + n] * rest[foot, n]
                    for m in range(3):
                        total[x + n] -= R[n, m] * J[m, k]
                else:
                    total[x + n] += leg[joint + n]
        if stance[foot]:
            lower[x + 2] = 0.0
            for axis in range(x, x + 2):
                for sign in (-1.0, 1.0):
                    A[row, axis] = sign
                    A[row, x + 2] = friction
                    lower[12 + row] = 0.0
                    row += 1
            for i in range(x, x + 3):
                H[i, i] = FORCE_WEIGHT
            continue
        desired = apply_transposed(R, tasks.feet[foot])
        for i in range(3):  # a + α × r + J q̈ + β, in the trunk's axes
            miss, j1, j2 = error[errors], (i + 1) % 3, (i + 2) % 3
            for j in range(13):
                miss[j] = trunk[i, j] + trunk[3 + j1, j] * r[j2] - trunk[3 + j2, j] * r[j1]
            for k in range(3):
                miss[x + k] += J[i, k]
            miss[12] += beta[foot, i] - desired[i]
            errors += 1

    for miss in error[:errors]:
        for i in range(12):
            e = miss[i]
            for j in range(12):
                H[i, j] += e * miss[j]
            f[i] += e * miss[12]
    A[:12] = torque[:, :12]
    out.torque_offset[:] = torque[:, 12]
    lower[12:24] = limits[0] - out.torque_offset
    upper[12:24] = limits[1] - out.torque_offset
    return (row - 12) // 4


@njit(cache=True)
def free_minimiser(program: np.record, rows: int) -> bool:
    """Set ``z = −H⁻¹f`` and return whether it keeps to every bound: then it is optimal.

    While the robot walks undisturbed no friction or torque limit binds, and the QP needs no solver.

    Args:
        program: a `WORKSPACE` record; the first `rows` rows of A count.
        rows: how many.
    """
    n, x = 12, program.z
    L = np.zeros((n, n))  # Cholesky factor of H
    for i in range(n):
        for j in range(i + 1):
            total = program.H[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i > j:
                L[i, j] = total / L[j, j]
            elif total > 0.0:
                L[i, i] = np.sqrt(total)
            else:
                return False
    for i in range(n):
        total = -program.f[i]
        for k in range(i):
            total -= L[i, k] * x[k]
        x[i] = total / L[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= L[k, i] * x[k]
        x[i] /= L[i, i]
    for i in range(n):
        if not program.lower[i] <= x[i] <= program.upper[i]:
            return False
    for row in range(rows):
        value = 0.0
        for k in range(n):
            value += program.A[row, k] * x[k]
        if not program.lower[n + row] <= value <= program.upper[n + row]:
            return False
    return True


@njit(cache=True)
def set_torque(work: np.record) -> None:
    """Add up feedforward and feedback within the limits."""
    for joint in range(12):
        total = work.feedforward[joint] + work.feedback[joint]
        work.torque[joint] = min(max(total, work.limits[0, joint]), work.limits[1, joint])


@njit(cache=True)
def take_solution(work: np.record) -> None:
    """Set the torques of the solution in ``work.z``."""
    work.feedforward[:] = apply(work.A[:12], work.z) + work.torque_offset
    set_torque(work)
