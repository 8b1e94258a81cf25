"""The task-space QP with everything that the equalities fix taken out: twelve unknowns remain.

Each leg brings three: its contact force F_i if it stands, its joint accelerations q̈_i if it swings.
A standing foot does not move, ``B_i a + J_i q̈_i + β_i = 0`` with a the trunk's acceleration and
``B_i = [1, −r_i×]``, which gives q̈_i through a 3×3 inverse; the trunk's six rows of the dynamics
then give a, and the legs' rows τ. So everything is affine in the unknowns z and kept as a matrix
with 13 columns, ``· [z; 1]``.

`task_space.py` poses the same program in the paper's form; both give the same torques.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.locomotion.leg import FootKinematics
from hcbf_gym.locomotion.matrices import (
    add_product,
    apply,
    cross,
    inverse_3x3,
    product,
    skew,
    solve_in_place,
)
from hcbf_gym.locomotion.state import Array
from hcbf_gym.locomotion.task_space import (
    FORCE_WEIGHT,
    foot_bias,
)
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
            ("torque", "f8", 12),  # their sum within the limit [N·m]
        ],
    )
)


@njit(cache=True)
def accelerations(
    M: Array,
    bias: Array,
    R: Array,
    feet: FootKinematics,
    beta: Array,
    stance: NDArray[np.bool_],
) -> Array:
    """Return (18, 13) Q with ``q̈ = Q [z; 1]``.

    Args:
        M: (18, 18) mass matrix.
        bias: (18,) forces.
        R: (3, 3) trunk → world.
        feet: the feet's kinematics in the trunk's axes.
        beta: (4, 3) the feet's accelerations, in the trunk's axes, that q̈ does not cause.
        stance: (4,) bool.
    """
    Q = np.zeros((18, 13))
    trunk = Q[:6]
    trunk[:, 12] = -bias[:6]
    inertia = M[:6, :6].copy()
    lever = np.empty((4, 3, 6))  # −J⁻¹B
    for foot in range(4):
        column = 3 * foot
        coupling = M[:6, 6 + column : 9 + column]
        if not stance[foot]:
            for i in range(3):
                trunk[:, column + i] = -coupling[:, i]
                Q[6 + column + i, column + i] = 1.0
            continue
        J_inverse = inverse_3x3(feet.jacobian[foot])
        lever[foot, :, :3] = -J_inverse
        lever[foot, :, 3:] = product(J_inverse, skew(feet.position[foot]))
        rest = -apply(J_inverse, beta[foot])
        Q[6 + column : 9 + column, 12] = rest
        add_product(inertia, coupling, lever[foot])
        trunk[:, 12] -= apply(coupling, rest)
        trunk[:3, column : column + 3] = R.T
        trunk[3:, column : column + 3] = product(skew(feet.position[foot]), R.T)
    solve_in_place(inertia, trunk)
    for foot in range(4):
        if stance[foot]:
            add_product(Q[6 + 3 * foot : 9 + 3 * foot], lever[foot], trunk)
    return Q


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
        torque_limit: of every joint [N·m].
        out: a `WORKSPACE` record; the rows ``A[: 12 + 4c]`` count.
    """
    beta = np.empty((4, 3))
    for foot in range(4):
        rate = v[6 + 3 * foot : 9 + 3 * foot]
        beta[foot] = foot_bias(v, feet.position[foot], feet.jacobian[foot], feet.bias[foot], rate)
    Q = accelerations(M, bias, R, feet, beta, stance)
    trunk = Q[:6]

    H, f, A, lower, upper = out.H, out.f, out.A, out.lower, out.upper
    H[:] = 0.0
    f[:] = 0.0
    A[12:] = 0.0
    lower[:] = -np.inf
    upper[:] = np.inf
    torque = np.zeros((12, 13))
    error = np.zeros((18, 13))  # of the tasks, trunk linear, trunk angular, feet

    error[3:6] = trunk[3:]
    error[3:6, 12] -= tasks.angular
    add_product(error[:3], R, trunk[:3])
    error[:3, 12] += apply(R, cross(v[3:6], v[:3])) - tasks.linear
    error[2] *= np.sqrt(HEIGHT_WEIGHT)

    row = 12
    for foot in range(4):
        x, z = 3 * foot, 3 * foot + 2
        k, joints = slice(x, x + 3), slice(6 + x, 9 + x)
        J_world = product(R, feet.jacobian[foot])
        add_product(torque[k], M[joints, :6], trunk)
        add_product(torque[k], M[joints, joints], Q[joints])
        torque[k, 12] += bias[joints]
        if stance[foot]:
            torque[k, k] -= J_world.T
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
            add_product(error[joints], R, trunk[:3])
            add_product(error[joints], product(R, skew(-feet.position[foot])), trunk[3:])
            error[joints, k] += J_world
            error[joints, 12] += apply(R, beta[foot]) - tasks.feet[foot]

    for row_of_error in error:
        for i in range(12):
            e = row_of_error[i]
            if e != 0.0:
                for j in range(12):
                    H[i, j] += e * row_of_error[j]
                f[i] += e * row_of_error[12]
    A[:12] = torque[:, :12]
    out.torque_offset[:] = torque[:, 12]
    lower[12:24] = -torque_limit - out.torque_offset
    upper[12:24] = torque_limit - out.torque_offset
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
def set_torque(work: np.record, torque_limit: float) -> None:
    """Add up feedforward and feedback within ±torque_limit [N·m]."""
    for joint in range(12):
        total = work.feedforward[joint] + work.feedback[joint]
        work.torque[joint] = min(max(total, -torque_limit), torque_limit)


@njit(cache=True)
def take_solution(work: np.record, torque_limit: float) -> None:
    """Set the torques of the solution in ``work.z``."""
    work.feedforward[:] = apply(work.A[:12], work.z) + work.torque_offset
    set_torque(work, torque_limit)
