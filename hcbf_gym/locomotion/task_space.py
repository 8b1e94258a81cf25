"""The task-space QP over (q̈, τ, F), everything that its equalities fix taken out.

    min ‖J_y q̈ + J̇_y q̇ − ÿ‖² + w‖F‖²   subject to   D q̈ + H = Sᵀτ + J_cᵀF,  J_c q̈ + J̇_c q̇ = 0,
                                                     |F_x|, |F_y| ≤ µ F_z,  τ_min ≤ τ ≤ τ_max

Twelve unknowns remain (section II-B of the paper, "Task-Space Controller").

Each leg brings three: its contact force F_i if it stands, its joint accelerations q̈_i if it swings.
A standing foot does not move, ``B_i a + J_i q̈_i + β_i = 0`` with a the trunk's acceleration and
``B_i = [1, −r_i×]``, which gives q̈_i through a 3×3 inverse; the trunk's six rows of the dynamics
then give a, and the legs' rows τ. So everything is affine in the unknowns z and stored as a matrix
with 13 columns, ``· [z; 1]``.

The tests hold its torques to those of the program as the paper poses it.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.compilation import kernel
from hcbf_gym.locomotion.dynamics import Dynamics
from hcbf_gym.locomotion.leg import foot_bias
from hcbf_gym.locomotion.matrices import (
    add_cross,
    apply,
    apply_transposed,
    cross,
    inverse_3x3,
    solve_in_place,
)
from hcbf_gym.locomotion.tasks import FORCE_WEIGHT, HEIGHT_WEIGHT, TaskAccelerations

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


@kernel()
def accelerations(robot: Dynamics, beta: Array) -> Accelerations:
    """Return q̈ as it depends on z, from the trunk's rows of the dynamics.

    Args:
        robot: at this instant.
        beta: (4, 3) the feet's accelerations, in the trunk's axes, that q̈ does not cause.
    """
    M, bias, R, feet = robot.M, robot.bias, robot.R, robot.feet
    trunk, inertia = np.zeros((6, 13)), np.empty((6, 6))
    lever, rest = np.zeros((4, 3, 6)), np.zeros((4, 3))
    for i in range(6):
        trunk[i, 12] = -bias[i]
        for j in range(6):
            inertia[i, j] = M[i, j]
    for foot in range(4):
        x = 3 * foot
        joint = 6 + 3 * foot
        if not robot.stance[foot]:
            for i in range(6):
                for k in range(3):
                    trunk[i, x + k] = -M[i, joint + k]
            continue
        r = feet.position[foot]
        J_inverse = inverse_3x3(feet.jacobian[foot])
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


@kernel()
def condense(
    robot: Dynamics, tasks: TaskAccelerations, friction: float, limits: Array, out: np.record
) -> int:
    """Fill in the program in z (12,) and return how many feet stand, c.

    Args:
        robot: at this instant.
        tasks: the accelerations to come close to.
        friction: µ of the friction pyramid.
        limits: (2, 12) least and largest torque of each joint [N·m].
        out: a `WORKSPACE` record; the rows ``A[: 12 + 4c]`` count.
    """
    v, feet, stance = robot.v, robot.feet, robot.stance
    beta = np.empty((4, 3))
    for foot in range(4):
        rate = v[6 + 3 * foot : 9 + 3 * foot]
        beta[foot] = foot_bias(v, feet.position[foot], feet.jacobian[foot], feet.bias[foot], rate)
    q = accelerations(robot, beta)

    H, f, A, lower, upper = out.H, out.f, out.A, out.lower, out.upper
    H[:] = 0.0
    f[:] = 0.0
    A[12:] = 0.0
    lower[:] = -np.inf
    upper[:] = np.inf
    torque = np.zeros((12, 13))
    error = np.zeros((18, 13))  # of the tasks: trunk linear, trunk angular, feet that swing
    trunk_errors(error, robot, q.trunk, tasks)
    errors, contacts = 6, 0
    for foot in range(4):
        for k in range(3):
            joint_torque(torque[3 * foot + k], robot, q, foot, k)
        if stance[foot]:
            bound_force(out, foot, contacts, friction)
            contacts += 1
        else:
            missing = apply_transposed(robot.R, tasks.feet[foot]) - beta[foot]
            swing_errors(error[errors : errors + 3], robot, q.trunk, foot, missing)
            errors += 3
    add_squares(H, f, error[:errors])
    A[:12] = torque[:, :12]
    out.torque_offset[:] = torque[:, 12]
    lower[12:24] = limits[0] - out.torque_offset
    upper[12:24] = limits[1] - out.torque_offset
    return contacts


@kernel()
def trunk_errors(error: Array, robot: Dynamics, trunk: Array, tasks: TaskAccelerations) -> None:
    """Add the errors of the trunk's tasks, ``error[:6] [z; 1]``, weighted.

    Args:
        error: (18, 13) of all tasks.
        robot: at this instant.
        trunk: (6, 13) the trunk's acceleration.
        tasks: the accelerations to come close to.
    """
    R = robot.R
    drift = cross(robot.v[3:6], robot.v[:3])
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


@kernel()
def swing_errors(error: Array, robot: Dynamics, trunk: Array, foot: int, missing: Array) -> None:
    """Add the errors of a swinging foot, ``a + α × r + J q̈ + β − ÿ`` in the trunk's axes.

    Args:
        error: (3, 13) of this foot.
        robot: at this instant.
        trunk: (6, 13) the trunk's acceleration, linear a and angular α.
        foot: which.
        missing: (3,) ÿ − β, what q̈ must bring about [m/s²].
    """
    r = robot.feet.position[foot]
    J = robot.feet.jacobian[foot]
    for i in range(3):
        j1, j2 = (i + 1) % 3, (i + 2) % 3
        for j in range(13):
            error[i, j] = trunk[i, j] + trunk[3 + j1, j] * r[j2] - trunk[3 + j2, j] * r[j1]
        for k in range(3):
            error[i, 3 * foot + k] += J[i, k]
        error[i, 12] -= missing[i]


@kernel()
def joint_torque(torque: Array, robot: Dynamics, q: Accelerations, foot: int, k: int) -> None:
    """Add a leg's row of the dynamics, ``τ = torque [z; 1]``.

    Args:
        torque: (13,) of this joint.
        robot: at this instant.
        q: how the unknowns accelerate the robot.
        foot: of which leg.
        k: 0 for its abad joint, 1 hip, 2 knee.
    """
    x = 3 * foot
    joint = 6 + 3 * foot
    row = robot.M[joint + k]
    R = robot.R
    J = robot.feet.jacobian[foot]
    torque[12] = robot.bias[joint + k]
    for i in range(6):
        of_trunk = row[i]
        for n in range(3):  # a standing leg moves with the trunk; a swinging one's lever is zero
            of_trunk += row[joint + n] * q.lever[foot, n, i]
        for j in range(13):
            torque[j] += of_trunk * q.trunk[i, j]
    if not robot.stance[foot]:
        for n in range(3):
            torque[x + n] += row[joint + n]
        return
    for n in range(3):
        torque[12] += row[joint + n] * q.rest[foot, n]
        for m in range(3):
            torque[x + n] -= R[n, m] * J[m, k]


@kernel()
def bound_force(out: np.record, foot: int, contact: int, friction: float) -> None:
    """Confine a standing foot's force to its friction pyramid, ``|F_x|, |F_y| ≤ µ F_z``, and small.

    Args:
        out: the `WORKSPACE` record.
        foot: which.
        contact: how many feet before it stand.
        friction: µ.
    """
    x = 3 * foot
    row = 12 + 4 * contact
    out.lower[x + 2] = 0.0
    out.lower[12 + row : 16 + row] = 0.0
    for axis in range(x, x + 2):
        for sign in (-1.0, 1.0):
            out.A[row, axis] = sign
            out.A[row, x + 2] = friction
            row += 1
    for i in range(x, x + 3):
        out.H[i, i] = FORCE_WEIGHT


@kernel()
def add_squares(H: Array, f: Array, error: Array) -> None:
    """Add ``½ ‖error [z; 1]‖²`` of errors (k, 13) to the objective."""
    for miss in error:
        for i in range(12):
            e = miss[i]
            for j in range(12):
                H[i, j] += e * miss[j]
            f[i] += e * miss[12]


@kernel()
def free_minimiser(program: np.record, rows: int) -> bool:
    """Set ``z = −H⁻¹f`` and return whether it meets every bound: then it is optimal.

    While the robot walks undisturbed no friction or torque limit binds, and the QP needs no solver.

    Args:
        program: a `WORKSPACE` record; the first `rows` rows of A count.
        rows: how many.
    """
    n = 12
    x = program.z
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


@kernel()
def set_torque(work: np.record) -> None:
    """Add up feedforward and feedback within the limits."""
    for joint in range(12):
        total = work.feedforward[joint] + work.feedback[joint]
        work.torque[joint] = min(max(total, work.limits[0, joint]), work.limits[1, joint])


@kernel()
def take_solution(work: np.record) -> None:
    """Set the torques of the solution in ``work.z``."""
    work.feedforward[:] = apply(work.A[:12], work.z) + work.torque_offset
    set_torque(work)
