"""The task-space controller as the paper poses it, in (q̈, τ, F): the reference of what runs."""

# ruff: noqa: N803, N806 - matrices keep their usual capitals

from typing import Any

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, record_type
from hcbf_gym.locomotion.qp import QuadraticProgram

DYNAMICS = record_type("Dynamics")
TASKS = record_type("TaskAccelerations")
PLAN = record_type("TickPlan")


def foot_jacobian(R: Array, feet: Any, foot: int) -> Array:
    """Return (3, 18) the foot's Jacobian in the world's axes, ``R [1, −r×, J]``."""
    own, r = np.zeros((3, 18)), feet.position[foot]
    own[:, :3] = np.eye(3)
    own[:, 3:6] = np.cross(np.eye(3), r).T
    own[:, 6 + 3 * foot : 9 + 3 * foot] = feet.jacobian[foot]
    return R @ own


def foot_drift(R: Array, v: Array, feet: Any, foot: int) -> Array:
    """Return (3,) ``J̇_c q̇`` of a foot in the world's axes [m/s²]."""
    rate = v[6 + 3 * foot : 9 + 3 * foot]
    return R @ _core.foot_bias(v, feet.position[foot], feet.jacobian[foot], feet.bias[foot], rate)


def paper_program(
    robot: np.record, tasks: np.record, friction: float, limits: Array
) -> QuadraticProgram:
    """Return the program in x = (q̈ (18,), τ (12,), F (3 per standing foot)).

    ``min ‖J_y q̈ + J̇_y q̇ − ÿ‖² + w‖F‖²`` subject to ``D q̈ + H = Sᵀτ + J_cᵀF``,
    ``J_c q̈ + J̇_c q̇ = 0``, ``|F_x|, |F_y| ≤ µ F_z`` and ``τ_min ≤ τ ≤ τ_max``: the contact wrench
    cone of point feet, as a pyramid.

    Source: section II-B of the paper, "Task-Space Controller".
    """
    M, bias, v, R, stance = robot.M, robot.bias, robot.v, robot.R, robot.stance
    feet = robot.feet
    standing = [foot for foot in range(4) if stance[foot]]
    swinging = [foot for foot in range(4) if not stance[foot]]

    J_trunk = np.zeros((6, 18))
    J_trunk[:3, :3], J_trunk[3:, 3:6] = R, np.eye(3)
    trunk = np.concatenate([tasks.linear - R @ np.cross(v[3:6], v[:3]), tasks.angular])
    J_y = np.vstack([J_trunk, *(foot_jacobian(R, feet, foot) for foot in swinging)])
    y = np.concatenate([trunk, *(tasks.feet[f] - foot_drift(R, v, feet, f) for f in swinging)])
    weight = np.ones(len(y))
    weight[2] = _core.HEIGHT_WEIGHT

    n = 30 + 3 * len(standing)
    H, f = np.zeros((n, n)), np.zeros(n)
    H[:18, :18] = J_y.T @ (weight[:, None] * J_y)
    H[30:, 30:] = _core.FORCE_WEIGHT * np.eye(3 * len(standing))
    f[:18] = -J_y.T @ (weight * y)

    J_c = np.vstack([np.zeros((0, 18)), *(foot_jacobian(R, feet, foot) for foot in standing)])
    dynamics = np.hstack([M, -np.eye(18)[:, 6:], -J_c.T])
    contact = np.hstack([J_c, np.zeros((len(J_c), n - 18))])
    pyramid = np.zeros((4 * len(standing), n))
    for k in range(len(standing)):
        pyramid[4 * k : 4 * k + 4, 30 + 3 * k : 33 + 3 * k] = [
            [-1.0, 0.0, friction],
            [1.0, 0.0, friction],
            [0.0, -1.0, friction],
            [0.0, 1.0, friction],
        ]
    fixed = np.concatenate([-bias, *(-foot_drift(R, v, feet, foot) for foot in standing)])
    least, most = np.full(n, -np.inf), np.full(n, np.inf)
    least[18:30], most[18:30] = limits
    least[32::3] = 0.0
    return QuadraticProgram(
        H,
        f,
        np.vstack([dynamics, contact, pyramid]),
        np.concatenate([least, fixed, np.zeros(len(pyramid))]),
        np.concatenate([most, fixed, np.full(len(pyramid), np.inf)]),
        len(fixed),
    )
