"""The controller's own model of the robot, read by Pinocchio from an MJCF file."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.errors import RobotModelError
from hcbf_gym.locomotion.leg import LegGeometry
from hcbf_gym.robots import a1
from hcbf_gym.robots.reader import Quadruped

if TYPE_CHECKING:
    import pinocchio as pin


class Bodies(NamedTuple):
    """Inertias of the trunk and, leg by leg, of hip, thigh and calf; losses of the joints."""

    mass: Array  # (13,) [kg]
    com: Array  # (13, 3) centre of mass in the body's own axes [m]
    inertia: Array  # (13, 3, 3) about the centre of mass, in the body's own axes [kg·m²]
    armature: Array  # (12,) of the joints [kg·m²]
    damping: Array  # (12,) [N·m·s/rad]
    dry_friction: Array  # (12,) [N·m]


class RobotModel:
    """A floating trunk with four abad–hip–knee legs, read from a file without ``<include>``.

    Raises:
        RobotModelError: if Pinocchio cannot read the file, or `foot_kinematics` do not cover its
            legs.
    """

    def __init__(self, robot: Quadruped) -> None:
        self.pinocchio = model = _read(robot.xml_file)
        self.legs = _leg_geometry(model, robot)
        inertias = [model.inertias[joint] for joint in range(1, model.njoints)]
        self.bodies = Bodies(
            mass=np.array([inertia.mass for inertia in inertias]),
            com=np.array([inertia.lever for inertia in inertias]),
            inertia=np.array([inertia.inertia for inertia in inertias]),
            armature=model.armature[6:].copy(),
            damping=model.damping[6:].copy(),
            dry_friction=model.upperDryFrictionLimit[6:].copy(),
        )


def _read(xml_file: Path) -> "pin.Model":
    """Return Pinocchio's model of a file; refuse other joints than the A1's, or another order."""
    import pinocchio as pin  # imported here: robots on wheels work without Pinocchio

    try:
        model = pin.buildModelFromMJCF(str(xml_file))
    except Exception as error:  # Pinocchio raises whatever its parser throws
        raise RobotModelError(f"xml_file: {xml_file} is not MJCF that Pinocchio reads") from error
    names, sizes = list(model.names)[1:], list(model.nqs)[1:]  # the first joint is the universe
    hinges = [name for name, size in zip(names, sizes, strict=True) if size == 1]
    if sorted(hinges) != sorted(a1.JOINTS) or model.nq != 7 + 12 or model.nv != 6 + 12:
        raise RobotModelError(
            f"xml_file: got the hinge joints {hinges} and {model.nq - len(hinges)} further "
            f"coordinates, expected a free joint (7 coordinates) and the hinges {list(a1.JOINTS)}"
        )
    if hinges != list(a1.JOINTS):
        raise RobotModelError(f"xml_file: got the joint order {hinges}, expected {list(a1.JOINTS)}")
    return model


def _leg_geometry(model: "pin.Model", robot: Quadruped) -> LegGeometry:
    """Read the lengths; refuse legs whose axes or offsets the closed form does not cover."""
    placements = [model.jointPlacements[model.getJointId(name)] for name in a1.JOINTS]
    axes = [model.joints[model.getJointId(name)].shortname() for name in a1.JOINTS]
    # (leg; abad, hip or knee; x, y, z)
    offsets = np.array([placement.translation for placement in placements]).reshape(4, 3, 3)
    is_aligned = all(np.allclose(placement.rotation, np.eye(3)) for placement in placements)
    hip_is_beside_abad = np.allclose(offsets[:, 1, [0, 2]], 0.0)
    knee_is_below_hip = np.allclose(offsets[:, 2, :2], 0.0)
    thighs_are_equal = np.allclose(offsets[:, 2, 2], offsets[0, 2, 2])
    is_covered = is_aligned and hip_is_beside_abad and knee_is_below_hip and thighs_are_equal
    if axes != ["JointModelRX", "JointModelRY", "JointModelRY"] * 4 or not is_covered:
        raise RobotModelError(
            f"xml_file: {robot.xml_file} has joint axes {axes} and offsets {offsets.tolist()}, "
            "expected an abad axis x, hip and knee axes y, the hip straight beside the abad joint, "
            "the knee straight below the hip, and legs of one length"
        )
    return LegGeometry(
        hip=offsets[:, 0].copy(),
        offset=offsets[:, 1, 1].copy(),
        thigh=float(-offsets[0, 2, 2]),
        calf=robot.calf,
    )
