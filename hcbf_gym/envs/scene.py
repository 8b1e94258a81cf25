"""The scene as an MjSpec: the robot, the ground under it and boxes in its way."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from hcbf_gym.errors import RobotModelError, choose
from hcbf_gym.robots import a1

FIXED_BOX_RGBA = (0.55, 0.42, 0.30, 1.0)
LIGHT_BOX_RGBA = (0.95, 0.80, 0.15, 1.0)
FLOOR_RGBA = (0.8, 0.8, 0.8, 1.0)

ROUGH_STEP = 0.03  # [m] the highest step
ROUGH_BLOCK = 0.25  # [m] edge of a block of one height
ROUGH_CELL = 0.05  # [m] over which one block rises to the next
ROUGH_HALF_SIZE = 20.0  # [m] of the field, centred at the origin

PAYLOAD = "payload"
PAYLOAD_HALF_SIZE = (0.06, 0.05, 0.04)  # [m]


def robot_spec(xml_file: Path) -> mujoco.MjSpec:
    """Return the robot alone, its actuators replaced by torque motors.

    Raises:
        RobotModelError: if MuJoCo refuses the file, or trunk, joints or feet are not the A1's.
    """
    if not xml_file.is_file():
        raise RobotModelError(f"xml_file: got {str(xml_file)!r}, expected an existing MJCF file")
    try:
        spec = mujoco.MjSpec.from_file(str(xml_file))
    except ValueError as error:
        raise RobotModelError(f"xml_file: MuJoCo refuses {xml_file}: {error}") from error
    hinges = [joint.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE]
    free = [joint.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    if hinges != list(a1.JOINTS) or len(spec.joints) != 13 or len(free) != 1:
        raise RobotModelError(
            f"xml_file: got {len(free)} free joint(s) and the hinges {hinges}, "
            f"expected one and {list(a1.JOINTS)}"
        )
    if spec.body(a1.TRUNK) is None:
        bodies = sorted(body.name for body in spec.bodies)
        raise RobotModelError(f"xml_file: got the bodies {bodies}, expected one named {a1.TRUNK!r}")
    for element in (*spec.actuators, *spec.keys):  # keys would no longer fit the scene's qpos
        spec.delete(element)
    for name in a1.JOINTS:
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.forcelimited = True
        motor.forcerange = (-a1.TORQUE_LIMIT, a1.TORQUE_LIMIT)
    return spec


def set_physics(spec: mujoco.MjSpec, timestep: float) -> None:
    """Choose integrator and contact model: stiff feet that neither creep nor sink."""
    option = spec.option
    option.timestep = timestep
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 100.0
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a divergence is reported
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND  # one robot is one island


def add_ground(spec: mujoco.MjSpec, terrain: str) -> None:
    """Lay the ground and light it.

    Args:
        spec: of the scene.
        terrain: "flat", or "rough": blocks of random height up to `ROUGH_STEP`, always the same.
    """
    choose("terrain", terrain, {"flat": _add_plane, "rough": _add_rough_field})(spec)
    spec.worldbody.add_light(
        pos=(0, 0, 4), dir=(0.2, 0.2, -1), type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    )


def _add_plane(spec: mujoco.MjSpec) -> None:
    spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 0.05), rgba=FLOOR_RGBA
    )


def _add_rough_field(spec: mujoco.MjSpec) -> None:
    cells = round(ROUGH_BLOCK / ROUGH_CELL)
    blocks = round(2 * ROUGH_HALF_SIZE / ROUGH_BLOCK)
    heights = np.random.default_rng(0).random((blocks, blocks))
    field = np.kron(heights, np.ones((cells, cells)))
    spec.add_hfield(
        name="floor",
        nrow=field.shape[0],
        ncol=field.shape[1],
        size=(ROUGH_HALF_SIZE, ROUGH_HALF_SIZE, ROUGH_STEP, 0.1),
        userdata=field.ravel(),
    )
    spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="floor", rgba=FLOOR_RGBA
    )


def add_boxes(spec: mujoco.MjSpec, boxes: Sequence[Any]) -> None:
    """Put boxes on the ground.

    Args:
        spec: of the scene.
        boxes: records with ``name``, ``center`` (2,) [m], ``size`` (3,) full edges [m], ``yaw``
            [rad] and ``mass`` [kg], None for a box that cannot be moved.
    """
    for box in boxes:
        half = 0.5 * np.asarray(box.size)
        body = spec.worldbody.add_body(
            name=box.name,
            pos=(*box.center, half[2]),
            quat=(np.cos(box.yaw / 2), 0, 0, np.sin(box.yaw / 2)),
        )
        geom = body.add_geom(
            name=box.name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=half,
            rgba=FIXED_BOX_RGBA if box.mass is None else LIGHT_BOX_RGBA,
        )
        if box.mass is not None:
            geom.mass = box.mass
            body.add_freejoint()
            spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ISLAND)


def add_payload(spec: mujoco.MjSpec, position: Sequence[float]) -> None:
    """Strap a box to the trunk at `position` (3,) in its axes [m]; its mass is set at reset."""
    body = spec.body(a1.TRUNK).add_body(name=PAYLOAD, pos=position)
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=PAYLOAD_HALF_SIZE,
        rgba=FIXED_BOX_RGBA,
        mass=1.0,
        contype=0,
        conaffinity=0,
        group=2,
    )
