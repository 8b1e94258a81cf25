"""The controller's own rigid-body model: M(q), and everything that is not M(q)q̈."""

from pathlib import Path

import numpy as np
import pinocchio as pin
from numba import njit

from hcbf_gym.errors import RobotModelError
from hcbf_gym.locomotion.leg import LegGeometry
from hcbf_gym.locomotion.matrices import apply_transposed
from hcbf_gym.locomotion.rotation import rotation_matrix
from hcbf_gym.locomotion.state import Array, RobotState
from hcbf_gym.robots import a1

FRICTION_VELOCITY = 0.1  # [rad/s] over which dry friction reverses, so that noise cannot chatter


class RobotModel:
    """A floating trunk with four abad–hip–knee legs, read by Pinocchio from an MJCF file.

    Generalised velocities are Pinocchio's: trunk linear and angular in the trunk's axes, then the
    twelve joints.

    Args:
        xml_file: the robot alone, no ``<include>``.

    Raises:
        RobotModelError: if the file cannot be read, or is not a quadruped with the A1's joints.
    """

    def __init__(self, xml_file: Path) -> None:
        self.pinocchio = _read(xml_file)
        self.data = self.pinocchio.createData()
        self._q, self._v = np.zeros(19), np.zeros(18)
        self.legs = _leg_geometry(self.pinocchio, xml_file)
        self.mass = float(sum(inertia.mass for inertia in self.pinocchio.inertias))
        self.losses = np.stack(
            [self.pinocchio.damping[6:], self.pinocchio.upperDryFrictionLimit[6:]]
        )

    def dynamics(self, state: RobotState) -> tuple[Array, Array]:
        """Return M (18, 18), upper triangle only, and the nonlinear effects (18,).

        The latter are Coriolis, centrifugal and gravity forces. Both are Pinocchio's own buffers,
        overwritten by the next call.
        """
        fill_coordinates(self._q, self._v, *state[:6])
        pin.crba(self.pinocchio, self.data, self._q)
        pin.nonLinearEffects(self.pinocchio, self.data, self._q, self._v)
        return self.data.M, self.data.nle


@njit(cache=True)
def fill_coordinates(
    q: Array,
    v: Array,
    position: Array,
    quaternion: Array,
    linear_velocity: Array,
    angular_velocity: Array,
    joint_position: Array,
    joint_velocity: Array,
) -> None:
    """Write Pinocchio's q (19,), whose quaternion ends with w, and v (18,) of a `RobotState`."""
    q[:3] = position
    q[3:6] = quaternion[1:]
    q[6] = quaternion[0]
    q[7:] = joint_position
    v[:3] = apply_transposed(rotation_matrix(quaternion), linear_velocity)
    v[3:6] = angular_velocity
    v[6:] = joint_velocity


@njit(cache=True)
def with_joint_losses(nonlinear_effects: Array, v: Array, losses: Array) -> Array:
    """Return the bias (18,) of ``M q̈ + bias = Sᵀτ + JᵀF``: damping and dry friction added.

    Without them the trunk pitches by several degrees.

    Args:
        nonlinear_effects: (18,) Coriolis, centrifugal and gravity forces.
        v: (18,) generalised velocity.
        losses: (2, 12) the joints' damping [N·m·s/rad] and dry friction [N·m].
    """
    bias = nonlinear_effects.copy()
    for joint in range(12):
        rate = v[6 + joint]
        bias[6 + joint] += losses[0, joint] * rate
        bias[6 + joint] += losses[1, joint] * np.tanh(rate / FRICTION_VELOCITY)
    return bias


def _read(xml_file: Path) -> pin.Model:
    if not Path(xml_file).is_file():
        raise RobotModelError(f"xml_file: got {str(xml_file)!r}, expected an existing MJCF file")
    try:
        model = pin.buildModelFromMJCF(str(xml_file))
    except Exception as error:  # Pinocchio raises whatever its parser throws
        raise RobotModelError(f"xml_file: {xml_file} is not MJCF that Pinocchio reads") from error
    sizes = list(model.nqs)[1:]  # the first joint is the universe
    got = [name for name, nq in zip(list(model.names)[1:], sizes, strict=True) if nq == 1]
    if sorted(got) != sorted(a1.JOINTS) or model.nq != 19 or model.nv != 18:
        raise RobotModelError(
            f"xml_file: got the hinge joints {got} and {model.nq - len(got)} further coordinates, "
            f"expected a free joint (7 coordinates) and the hinges {list(a1.JOINTS)}"
        )
    if got != list(a1.JOINTS):
        raise RobotModelError(f"xml_file: got the joint order {got}, expected {list(a1.JOINTS)}")
    return model


def _leg_geometry(model: pin.Model, xml_file: Path) -> LegGeometry:
    """Read the lengths; refuse legs whose axes or offsets the closed form does not cover."""
    placements = [model.jointPlacements[model.getJointId(name)] for name in a1.JOINTS]
    axes = [model.joints[model.getJointId(name)].shortname() for name in a1.JOINTS]
    offsets = np.array([placement.translation for placement in placements]).reshape(4, 3, 3)
    straight = all(np.allclose(placement.rotation, np.eye(3)) for placement in placements)
    plain = np.allclose(offsets[:, 1, [0, 2]], 0.0) and np.allclose(offsets[:, 2, :2], 0.0)
    equal = np.allclose(offsets[:, 2, 2], offsets[0, 2, 2])
    expected = ["JointModelRX", "JointModelRY", "JointModelRY"] * 4
    if axes != expected or not (straight and plain and equal):
        raise RobotModelError(
            f"xml_file: {xml_file} has joint axes {axes} and offsets {offsets.tolist()}, expected "
            "an abad axis x, hip and knee axes y, the hip straight beside the abad joint, the knee "
            "straight below the hip, and legs of one length"
        )
    return LegGeometry(
        hip=offsets[:, 0].copy(),
        offset=offsets[:, 1, 1].copy(),
        thigh=float(-offsets[0, 2, 2]),
        calf=a1.CALF_LENGTH,
    )
