"""Rigid-body dynamics of a trunk with four abad–hip–knee legs, compiled.

Everything is written in the trunk's axes at the trunk's origin, as spatial vectors with the linear
part first: there the inertias of bodies simply add up, and the trunk's rows need no transformation.
Pinocchio computes the same terms for any robot and is what these are tested against; compiled in
one piece with the rest of a tick, they need no way out of compiled code and back.

Source: R. Featherstone, Rigid Body Dynamics Algorithms (2008), chapters 5 and 6.
"""

from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array, Mask
from hcbf_gym.compilation import kernel
from hcbf_gym.locomotion.leg import FootKinematics, LegGeometry
from hcbf_gym.locomotion.matrices import add_cross
from hcbf_gym.models.constants import GRAVITY

FRICTION_VELOCITY = 0.1  # [rad/s] over which dry friction reverses, so that noise cannot chatter


class Dynamics(NamedTuple):
    """The robot at one instant, as its QPs see it: ``M q̈ + bias = Sᵀτ + J_cᵀF``.

    Attributes:
        M: (18, 18) mass matrix.
        bias: (18,) forces, joint losses included.
        v: (18,) generalised velocity.
        R: (3, 3) trunk → world.
        feet: the feet's kinematics in the trunk's axes.
        stance: (4,) bool, feet that do not move.
    """

    M: Array
    bias: Array
    v: Array
    R: Array
    feet: FootKinematics
    stance: Mask


class Bodies(NamedTuple):
    """Inertias of the trunk and, leg by leg, of hip, thigh and calf; losses of the joints.

    Attributes:
        mass: (13,) [kg].
        com: (13, 3) centre of mass in the body's own axes [m].
        inertia: (13, 3, 3) about the centre of mass, in the body's own axes [kg·m²].
        armature: (12,) of the joints [kg·m²].
        damping: (12,) [N·m·s/rad].
        dry_friction: (12,) [N·m].
    """

    mass: Array
    com: Array
    inertia: Array
    armature: Array
    damping: Array
    dry_friction: Array


# the same fields as one record, which compiled code reads
BODIES = np.dtype(
    (
        np.record,
        [
            ("mass", "f8", 13),
            ("com", "f8", (13, 3)),
            ("inertia", "f8", (13, 3, 3)),
            ("armature", "f8", 12),
            ("damping", "f8", 12),
            ("dry_friction", "f8", 12),
        ],
    )
)


@kernel()
def add_motion_cross(out: Array, velocity: Array, motion: Array) -> None:
    """Add to `out` (6,) how a velocity (6,) carries a motion vector (6,) along."""
    add_cross(out[:3], velocity[3:], motion[:3])
    add_cross(out[:3], velocity[:3], motion[3:])
    add_cross(out[3:], velocity[3:], motion[3:])


@kernel()
def add_force_cross(out: Array, velocity: Array, force: Array) -> None:
    """Add to `out` (6,) how a velocity (6,) carries a force vector (6,) along."""
    add_cross(out[:3], velocity[3:], force[:3])
    add_cross(out[3:], velocity[3:], force[3:])
    add_cross(out[3:], velocity[:3], force[:3])


@kernel()
def add_inertia(inertia: Array, mass: float, com: Array, about_com: Array, turn: Array) -> None:
    """Add a body to the spatial inertia (6, 6) about the trunk's origin.

    Args:
        inertia: (6, 6) added to.
        mass: m [kg].
        com: (3,) c in the trunk's axes [m].
        about_com: (3, 3) inertia about c in the body's axes [kg·m²].
        turn: (3, 3) body → trunk axes.
    """
    squared = com[0] ** 2 + com[1] ** 2 + com[2] ** 2
    for i in range(3):
        inertia[i, i] += mass
        inertia[3 + i, 3 + i] += mass * squared
        x = (
            turn[i, 0] * about_com[0, 0]
            + turn[i, 1] * about_com[1, 0]
            + turn[i, 2] * about_com[2, 0]
        )
        y = (
            turn[i, 0] * about_com[0, 1]
            + turn[i, 1] * about_com[1, 1]
            + turn[i, 2] * about_com[2, 1]
        )
        z = (
            turn[i, 0] * about_com[0, 2]
            + turn[i, 1] * about_com[1, 2]
            + turn[i, 2] * about_com[2, 2]
        )
        for j in range(3):
            turned = x * turn[j, 0] + y * turn[j, 1] + z * turn[j, 2]
            inertia[3 + i, 3 + j] += turned - mass * com[i] * com[j]
    for i in range(3):  # −m c× above, m c× below the diagonal
        j, k = (i + 1) % 3, (i + 2) % 3
        inertia[j, 3 + k] += mass * com[i]
        inertia[k, 3 + j] -= mass * com[i]
        inertia[3 + j, k] -= mass * com[i]
        inertia[3 + k, j] += mass * com[i]


@kernel()
def place_leg(
    legs: LegGeometry, leg: int, joints: Array, axes: Array, joint_places: Array, turns: Array
) -> None:
    """Fill in a leg's joint axes (3, 3), joint places (3, 3) and rotations link → trunk (3, 3, 3).

    Args:
        legs: their lengths.
        leg: which.
        joints: (3,) abad, hip, knee [rad].
        axes: filled, a row per joint.
        joint_places: filled, a row per joint [m].
        turns: filled.
    """
    sa, ca = np.sin(joints[0]), np.cos(joints[0])
    pitch = 0.0
    for j in range(3):
        if j > 0:
            pitch += joints[j]
        s, c = np.sin(pitch), np.cos(pitch)
        turns[j, 0, 0], turns[j, 0, 1], turns[j, 0, 2] = c, 0.0, s
        turns[j, 1, 0], turns[j, 1, 1], turns[j, 1, 2] = sa * s, ca, -sa * c
        turns[j, 2, 0], turns[j, 2, 1], turns[j, 2, 2] = -ca * s, sa, ca * c
        axes[j, 0], axes[j, 1], axes[j, 2] = (1.0, 0.0, 0.0) if j == 0 else (0.0, ca, sa)
    for i in range(3):
        joint_places[0, i] = legs.hip[leg, i]
        joint_places[1, i] = joint_places[0, i] + legs.offset[leg] * turns[0, i, 1]
        joint_places[2, i] = joint_places[1, i] - legs.thigh * turns[1, i, 2]


@kernel()
def rigid_body_terms(
    bodies: Bodies, legs: LegGeometry, R: Array, v: Array, joints: Array
) -> tuple[Array, Array]:
    """Return M (18, 18) and the bias (18,) of ``M q̈ + bias = Sᵀτ + JᵀF``.

    The bias holds Coriolis, centrifugal and gravity forces, and the joints' damping and dry
    friction: without the losses the trunk pitches by several degrees.

    Args:
        bodies: inertias and losses.
        legs: their lengths.
        R: (3, 3) trunk → world.
        v: (18,) trunk linear and angular in the trunk's axes, then the joints.
        joints: (12,) [rad].
    """
    M = np.zeros((18, 18))
    bias = np.zeros(18)
    whole = M[:6, :6]  # the trunk's block is the inertia of everything
    axes, places, turns = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3, 3))
    inertia = np.empty((3, 6, 6))  # of a link and all beyond it
    force = np.empty((3, 6))  # on a link and all beyond it
    S, V, A = np.empty((3, 6)), np.empty((3, 6)), np.empty((3, 6))
    momentum, com, reaction = np.empty(6), np.empty(3), np.empty(6)
    rest = np.zeros(6)
    rest[:3] = GRAVITY * R[2]  # the ground accelerates upwards

    add_inertia(whole, bodies.mass[0], bodies.com[0], bodies.inertia[0], np.eye(3))
    add_force(bias[:6], whole, v[:6], rest, momentum)
    for leg in range(4):
        place_leg(legs, leg, joints[3 * leg : 3 * leg + 3], axes, places, turns)
        for j in range(3):
            rate = v[6 + 3 * leg + j]
            before_V, before_A = (v[:6], rest) if j == 0 else (V[j - 1], A[j - 1])
            S[j, :3] = 0.0
            S[j, 3:] = axes[j]
            add_cross(S[j, :3], places[j], axes[j])
            for i in range(6):
                V[j, i] = before_V[i] + S[j, i] * rate
                reaction[i] = 0.0
            add_motion_cross(reaction, before_V, S[j])
            for i in range(6):
                A[j, i] = before_A[i] + reaction[i] * rate

            body = 1 + 3 * leg + j
            for i in range(3):
                com[i] = places[j, i]
                for k in range(3):
                    com[i] += turns[j, i, k] * bodies.com[body, k]
            inertia[j] = 0.0
            add_inertia(inertia[j], bodies.mass[body], com, bodies.inertia[body], turns[j])
            force[j] = 0.0
            add_force(force[j], inertia[j], V[j], A[j], momentum)

        for j in range(2, -1, -1):
            row = 6 + 3 * leg + j
            if j < 2:
                for i in range(6):
                    force[j, i] += force[j + 1, i]
                    for k in range(6):
                        inertia[j, i, k] += inertia[j + 1, i, k]
            for i in range(6):
                bias[row] += S[j, i] * force[j, i]
                total = 0.0
                for k in range(6):
                    total += inertia[j, i, k] * S[j, k]
                reaction[i] = M[i, row] = M[row, i] = total
            for ancestor in range(j + 1):
                total = 0.0
                for i in range(6):
                    total += S[ancestor, i] * reaction[i]
                M[6 + 3 * leg + ancestor, row] = M[row, 6 + 3 * leg + ancestor] = total
        for i in range(6):
            bias[i] += force[0, i]
            for k in range(6):
                whole[i, k] += inertia[0, i, k]

    for joint in range(12):
        rate = v[6 + joint]
        M[6 + joint, 6 + joint] += bodies.armature[joint]
        bias[6 + joint] += bodies.damping[joint] * rate
        bias[6 + joint] += bodies.dry_friction[joint] * np.tanh(rate / FRICTION_VELOCITY)
    return M, bias


@kernel()
def add_force(force: Array, inertia: Array, V: Array, A: Array, momentum: Array) -> None:
    """Add ``I A + V ×* I V``, the force that moves a body so; `momentum` (6,) is overwritten."""
    for i in range(6):
        along_V, along_A = 0.0, 0.0
        for k in range(6):
            along_V += inertia[i, k] * V[k]
            along_A += inertia[i, k] * A[k]
        momentum[i] = along_V
        force[i] += along_A
    add_force_cross(force, V, momentum)
