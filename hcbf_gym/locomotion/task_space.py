"""The task-space controller as the paper poses it, in (q̈, τ, F): the program of reference."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.locomotion.leg import FootKinematics
from hcbf_gym.locomotion.matrices import add_product, apply, apply_transposed, cross, product, skew
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


@njit(cache=True)
def foot_jacobian(R: Array, r: Array, J: Array, foot: int) -> Array:
    """Return (3, 18) the foot's Jacobian in the world's axes, ``R [1, −r×, J]``."""
    jacobian = np.zeros((3, 18))
    jacobian[:, :3] = R
    jacobian[:, 3:6] = product(R, skew(-r))
    jacobian[:, 6 + 3 * foot : 9 + 3 * foot] = product(R, J)
    return jacobian


@njit(cache=True)
def foot_bias(v: Array, r: Array, J: Array, bias: Array, joint_velocity: Array) -> Array:
    """Return (3,) a foot's acceleration, in the trunk's axes, when all generalised ones are zero.

    ``ω×v + ω×(ω×r) + 2 ω×(J q̇) + J̇ q̇`` with (v, ω) the trunk's velocity in its own axes: with
    the Jacobian of `foot_jacobian` this is ``Rᵀ J̇_c q̇``.
    """
    omega = v[3:6]
    return cross(omega, v[:3] + cross(omega, r) + 2.0 * apply(J, joint_velocity)) + bias


@njit(cache=True)
def full_form(
    M: Array,
    bias: Array,
    v: Array,
    R: Array,
    feet: FootKinematics,
    stance: NDArray[np.bool_],
    tasks: TaskAccelerations,
    friction: float,
    torque_limit: float,
) -> QuadraticProgram:
    """Return the program in x = (q̈ (18,), τ (12,), F (3 per standing foot)).

    ``min ‖J_y q̈ + J̇_y q̇ − ÿ‖² + w‖F‖²`` subject to ``D q̈ + H = Sᵀτ + J_cᵀF``,
    ``J_c q̈ + J̇_c q̇ = 0``, ``|F_x|, |F_y| ≤ µ F_z`` and ``|τ| ≤ τ_max``: the contact wrench cone
    of point feet, as a pyramid.

    Args:
        M: (18, 18) D.
        bias: (18,) H.
        v: (18,) q̇, generalised velocity.
        R: (3, 3) trunk → world.
        feet: the feet's kinematics in the trunk's axes.
        stance: (4,) bool, feet that do not move.
        tasks: the accelerations ÿ to come close to.
        friction: µ.
        torque_limit: τ_max [N·m].

    Source: section II-B of the paper, "Task-Space Controller".
    """
    contacts = 0
    for foot in range(4):
        contacts += stance[foot]
    n = 30 + 3 * contacts
    equalities = 18 + 3 * contacts
    J_y = np.zeros((18, 18))  # trunk linear, trunk angular, feet
    y = np.zeros(18)
    A = np.zeros((equalities + 4 * contacts, n))
    lower = np.full(n + len(A), -np.inf)
    upper = np.full(n + len(A), np.inf)
    H = np.zeros((n, n))

    J_y[:3, :3] = R
    y[:3] = tasks.linear - apply(R, cross(v[3:6], v[:3]))
    J_y[3:6, 3:6] = np.eye(3)
    y[3:6] = tasks.angular
    J_y[2] *= np.sqrt(HEIGHT_WEIGHT)
    y[2] *= np.sqrt(HEIGHT_WEIGHT)

    A[:18, :18] = M
    lower[n : n + 18] = -bias
    upper[n : n + 18] = -bias
    for joint in range(12):
        A[6 + joint, 18 + joint] = -1.0
        lower[18 + joint] = -torque_limit
        upper[18 + joint] = torque_limit

    force, contact_row, pyramid_row = 30, 18, equalities
    for foot in range(4):
        joint_velocity = v[6 + 3 * foot : 9 + 3 * foot]
        r, J = feet.position[foot], feet.jacobian[foot]
        J_foot = foot_jacobian(R, r, J, foot)
        drift = apply(R, foot_bias(v, r, J, feet.bias[foot], joint_velocity))
        if not stance[foot]:
            J_y[6 + 3 * foot : 9 + 3 * foot] = J_foot
            y[6 + 3 * foot : 9 + 3 * foot] = tasks.feet[foot] - drift
            continue
        A[:18, force : force + 3] = -J_foot.T
        A[contact_row : contact_row + 3, :18] = J_foot
        lower[n + contact_row : n + contact_row + 3] = -drift
        upper[n + contact_row : n + contact_row + 3] = -drift
        lower[force + 2] = 0.0
        for axis in range(2):
            for sign in (-1.0, 1.0):
                A[pyramid_row, force + axis] = sign
                A[pyramid_row, force + 2] = friction
                lower[n + pyramid_row] = 0.0
                pyramid_row += 1
        for i in range(force, force + 3):
            H[i, i] = FORCE_WEIGHT
        force += 3
        contact_row += 3
    add_product(H[:18, :18], J_y.T, J_y)
    f = np.zeros(n)
    f[:18] = -apply_transposed(J_y, y)
    return QuadraticProgram(H, f, A, lower, upper, equalities)
