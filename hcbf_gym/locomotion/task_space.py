"""The task-space controller as the paper poses it, in (q̈, τ, F): the program of reference."""

from typing import NamedTuple

import numpy as np
from numba import njit

from hcbf_gym.locomotion.dynamics import Dynamics
from hcbf_gym.locomotion.matrices import add_cross, apply, cross
from hcbf_gym.locomotion.state import Array
from hcbf_gym.locomotion.tasks import HEIGHT_WEIGHT, TaskAccelerations

FORCE_WEIGHT = 1e-4  # on ‖F‖², which decides between forces that do the same


class QuadraticProgram(NamedTuple):
    """``min ½ xᵀHx + fᵀx`` subject to ``lower ≤ [x; A x] ≤ upper``.

    Attributes:
        H: (n, n) positive semidefinite.
        f: (n,).
        A: (m, n) general rows.
        lower: (n + m,) bounds, those of the unknowns first.
        upper: (n + m,).
        equalities: how many of the general rows, the first ones, have equal bounds.
    """

    H: Array
    f: Array
    A: Array
    lower: Array
    upper: Array
    equalities: int


# the program's numbers, filled in by compiled code; those of `program_views` count
FULL_WORKSPACE = np.dtype(
    (
        np.record,
        [
            ("H", "f8", 42 * 42),
            ("f", "f8", 42),
            ("A", "f8", 46 * 42),
            ("lower", "f8", 42 + 46),
            ("upper", "f8", 42 + 46),
            ("feedback", "f8", 12),  # of the joint impedance [N·m]
            ("limits", "f8", (2, 12)),  # least and largest torque of each joint [N·m]
            ("feedforward", "f8", 12),  # τ of the latest solution [N·m]
            ("torque", "f8", 12),  # feedforward and feedback within the limits [N·m]
        ],
    )
)


def program_views(work: np.record, contacts: int) -> QuadraticProgram:
    """Return the program for so many standing feet as views of a `FULL_WORKSPACE` record."""
    equalities = 18 + 3 * contacts
    n, m = 30 + 3 * contacts, equalities + 4 * contacts
    return QuadraticProgram(
        work.H[: n * n].reshape(n, n),
        work.f[:n],
        work.A[: m * n].reshape(m, n),
        work.lower[: n + m],
        work.upper[: n + m],
        equalities,
    )


_program_views = njit(cache=True)(
    program_views
)  # for compiled code: what it returned to Python would dangle


@njit(cache=True)
def foot_jacobian(R: Array, r: Array, J: Array, foot: int) -> Array:
    """Return (3, 18) the foot's Jacobian in the world's axes, ``R [1, −r×, J]``."""
    jacobian = np.zeros((3, 18))
    for i in range(3):
        for k in range(3):
            jacobian[i, k] = R[i, k]
            for n in range(3):
                jacobian[i, 6 + 3 * foot + k] += R[i, n] * J[n, k]
        add_cross(jacobian[i, 3:6], r, R[i])
    return jacobian


@njit(cache=True)
def foot_bias(v: Array, r: Array, J: Array, bias: Array, joint_velocity: Array) -> Array:
    """Return (3,) a foot's acceleration, in the trunk's axes, when all generalised ones are zero.

    ``ω×v + ω×(ω×r) + 2 ω×(J q̇) + J̇ q̇`` with (v, ω) the trunk's velocity in its own axes: with
    the Jacobian of `foot_jacobian` this is ``Rᵀ J̇_c q̇``.
    """
    omega, carried, acceleration = v[3:6], np.empty(3), np.empty(3)
    for i in range(3):
        acceleration[i] = bias[i]
        carried[i] = v[i]
        for k in range(3):
            carried[i] += 2.0 * J[i, k] * joint_velocity[k]
    add_cross(carried, omega, r)
    add_cross(acceleration, omega, carried)
    return acceleration


@njit(cache=True)
def full_form(
    robot: Dynamics, tasks: TaskAccelerations, friction: float, limits: Array, out: np.record
) -> int:
    """Fill in the program in x = (q̈ (18,), τ (12,), F (3 per standing foot)) and return how many.

    ``min ‖J_y q̈ + J̇_y q̇ − ÿ‖² + w‖F‖²`` subject to ``D q̈ + H = Sᵀτ + J_cᵀF``,
    ``J_c q̈ + J̇_c q̇ = 0``, ``|F_x|, |F_y| ≤ µ F_z`` and ``τ_min ≤ τ ≤ τ_max``: the contact wrench
    cone of point feet, as a pyramid.

    Args:
        robot: at this instant, D its mass matrix and H its bias.
        tasks: the accelerations ÿ to come close to.
        friction: µ.
        limits: (2, 12) least and largest τ of each joint [N·m].
        out: a `FULL_WORKSPACE` record; read it through `program_views`.

    Source: section II-B of the paper, "Task-Space Controller".
    """
    M, bias, v, R, feet, stance = robot
    contacts = 0
    for foot in range(4):
        contacts += 1 if stance[foot] else 0
    H, f, A, lower, upper, equalities = _program_views(out, contacts)
    n = len(f)
    H[:] = 0.0
    f[:] = 0.0
    A[:] = 0.0
    lower[:] = -np.inf
    upper[:] = np.inf

    J_trunk, trunk, drift = np.zeros((6, 18)), np.empty(6), cross(v[3:6], v[:3])
    for i in range(3):
        trunk[i], trunk[3 + i] = tasks.linear[i], tasks.angular[i]
        for k in range(3):
            J_trunk[i, k] = R[i, k]
            trunk[i] -= R[i, k] * drift[k]
        J_trunk[3 + i, 3 + i] = 1.0
    for i in range(6):
        add_task(H, f, J_trunk[i], trunk[i], HEIGHT_WEIGHT if i == 2 else 1.0)

    for i in range(18):
        lower[n + i] = upper[n + i] = -bias[i]
        for j in range(18):
            A[i, j] = M[i, j]
    for joint in range(12):
        A[6 + joint, 18 + joint] = -1.0
        lower[18 + joint], upper[18 + joint] = limits[0, joint], limits[1, joint]

    force, contact_row, pyramid_row = 30, 18, equalities
    for foot in range(4):
        joint_velocity = v[6 + 3 * foot : 9 + 3 * foot]
        r, J = feet.position[foot], feet.jacobian[foot]
        J_foot = foot_jacobian(R, r, J, foot)
        drift = apply(R, foot_bias(v, r, J, feet.bias[foot], joint_velocity))
        if not stance[foot]:
            for i in range(3):
                add_task(H, f, J_foot[i], tasks.feet[foot, i] - drift[i], 1.0)
            continue
        for i in range(3):
            row = contact_row + i
            lower[n + row] = upper[n + row] = -drift[i]
            H[force + i, force + i] = FORCE_WEIGHT
            for j in range(18):
                A[row, j] = J_foot[i, j]
                A[j, force + i] = -J_foot[i, j]
        lower[force + 2] = 0.0
        for axis in range(2):
            for sign in (-1.0, 1.0):
                A[pyramid_row, force + axis] = sign
                A[pyramid_row, force + 2] = friction
                lower[n + pyramid_row] = 0.0
                pyramid_row += 1
        force += 3
        contact_row += 3
    return contacts


@njit(cache=True)
def add_task(H: Array, f: Array, j: Array, target: float, weight: float) -> None:
    """Add ``½ weight (j q̈ − target)²`` of one row j (18,) to the objective."""
    for i in range(18):
        e = weight * j[i]
        if e != 0.0:
            f[i] -= e * target
            for k in range(18):
                H[i, k] += e * j[k]
