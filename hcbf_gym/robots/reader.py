"""A robot's data for the controller, all read from its MJCF file without numbers of the A1."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.errors import RobotModelError
from hcbf_gym.models.constants import GRAVITY
from hcbf_gym.robots import a1

CLEARANCE = 0.001  # the distance between soles and ground in the home pose [m]
_DEFAULT_LEG = (0.0, 0.9, -1.8)  # abad, hip and knee in the home pose, if the file has none [rad]
_FREE, _HINGE = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_HINGE


@dataclass(frozen=True)
class Quadruped:
    """A trunk with four abad–hip–knee legs, joints ordered as in `a1.JOINTS`.

    Attributes:
        xml_file: the file that it was read from.
        calf: distance from the knee to the centre of the foot's sphere [m].
        foot_radius: radius of that sphere [m].
        stall_torque: (12,) torques of the joints' motors at rest [N·m].
        no_load_speed: (12,) speeds at which these torques are zero [rad/s]; infinite where the file
            has no ``<custom><numeric name="no_load_speed"/>``.
        home_joints: (12,) angles of the key "home", or 0, 0.9 and −1.8 on each leg [rad].
        home_height: height of the trunk's origin above flat ground in the home pose [m].
    """

    xml_file: Path
    calf: float
    foot_radius: float
    stall_torque: Array
    no_load_speed: Array
    home_joints: Array
    home_height: float


def load_spec(xml_file: str | Path) -> mujoco.MjSpec:
    """Return a robot's file as MuJoCo parses it.

    Raises:
        RobotModelError: if there is no such file, or MuJoCo refuses it.
    """
    if not isinstance(xml_file, str | Path) or not Path(xml_file).is_file():
        raise RobotModelError(f"xml_file: got {str(xml_file)!r}, expected an existing MJCF file")
    path = Path(xml_file)
    try:
        return mujoco.MjSpec.from_file(str(path))
    except (ValueError, UnicodeDecodeError) as error:
        raise RobotModelError(f"xml_file: MuJoCo refuses {path}: {error}") from error


def compile_spec(spec: mujoco.MjSpec, source: str | Path) -> mujoco.MjModel:
    """Return the compiled model of a file, which messages call `source`.

    Raises:
        RobotModelError: if MuJoCo refuses it, because of a missing mesh, an invalid mass, …
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise RobotModelError(f"xml_file: MuJoCo refuses {source}: {error}") from error


def read_robot(xml_file: str | Path = a1.XML_FILE) -> Quadruped:
    """Read a robot, and check that the controller can drive it.

    Its joints have the names `a1.JOINTS`. The foot is the lowest sphere of a calf. A torque limit
    is the actuator's force range, else the joint's ``actuatorfrcrange``, else the control range of
    a motor.

    Args:
        xml_file: MJCF of the robot alone.

    Raises:
        RobotModelError: if the file cannot be read, or describes no walking robot.
    """
    model = compile_spec(load_spec(xml_file), xml_file)
    _check_tree(model)
    _check_plausible(model)
    feet = [_foot_geom(model, leg) for leg in a1.LEGS]
    calf, radius = _foot(model, feet)
    joints, key_height = _home(model)
    height = max(key_height, _standing_height(model, joints, feet))
    robot = Quadruped(
        Path(xml_file), calf, radius, _stall_torque(model), _no_load_speed(model), joints, height
    )
    _check_strength(model, robot)
    for array in (robot.stall_torque, robot.no_load_speed, robot.home_joints):
        array.setflags(write=False)
    return robot


def check_alone(what: str, model: mujoco.MjModel, trunk: str) -> None:
    """Refuse a file, named `what` in the message, with bodies or geoms besides the robot."""
    is_of_robot = model.body_rootid == model.body(trunk).id
    is_of_robot[0] = True  # the world has no name to report
    others = [model.body(i).name for i in np.flatnonzero(~is_of_robot)]
    world_geoms = int((model.geom_bodyid == 0).sum())
    if others or world_geoms:
        raise RobotModelError(
            f"{what}: got {world_geoms} geom(s) in the world and the bodies {others} besides the "
            "robot, expected the robot alone: the simulation adds floor and obstacles"
        )


def actuator_limit(model: mujoco.MjModel, actuator: int) -> float:
    """Return an actuator's greatest torque [N·m]; infinite where it has no limit.

    The limit is its force range, else the control range of a motor.
    """
    gear = abs(model.actuator_gear[actuator, 0])
    if model.actuator_forcelimited[actuator]:
        return float(gear * np.abs(model.actuator_forcerange[actuator]).min())
    is_motor = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
    if is_motor and model.actuator_ctrllimited[actuator]:
        gain = abs(model.actuator_gainprm[actuator, 0])
        return float(gear * gain * np.abs(model.actuator_ctrlrange[actuator]).min())
    return np.inf


def foot_name(leg: str) -> str:
    """Return the name that the simulation gives to a leg's foot."""
    return f"{leg}_foot"


def _check_tree(model: mujoco.MjModel) -> None:
    """Refuse other joints than a free trunk with four abad–hip–knee legs."""
    names = [model.joint(i).name for i in range(model.njnt)]
    hinges = [name for name, kind in zip(names, model.jnt_type, strict=True) if kind == _HINGE]
    others = len(names) - len(hinges)
    if hinges != list(a1.JOINTS) or others != 1 or (model.jnt_type == _FREE).sum() != 1:
        raise RobotModelError(
            f"xml_file: got {others} joint(s) besides the hinges {hinges}, "
            f"expected one free joint and the hinges {list(a1.JOINTS)}"
        )
    bodies = [model.body(i).name for i in range(model.nbody)]
    if a1.TRUNK not in bodies:
        raise RobotModelError(f"xml_file: got the bodies {bodies}, expected one named {a1.TRUNK!r}")
    free_body = model.jnt_bodyid[model.jnt_type == _FREE][0]
    if bodies[free_body] != a1.TRUNK or model.body_parentid[free_body] != 0:
        raise RobotModelError(
            f"xml_file: got the free joint in body {bodies[free_body]!r}, expected it in "
            f"{a1.TRUNK!r}, a child of the world"
        )
    hinge_bodies = model.jnt_bodyid[1:]  # MuJoCo numbers the free joint first, as its body is
    parents = [names[model.body_jntadr[model.body_parentid[body]]] for body in hinge_bodies]
    free_joint = names[0]
    expected = [free_joint if i % 3 == 0 else a1.JOINTS[i - 1] for i in range(12)]
    if parents != expected:
        raise RobotModelError(
            f"xml_file: got joints that hang from {parents}, expected each leg's hip at the trunk, "
            "its thigh at the hip and its calf at the thigh"
        )


def _check_plausible(model: mujoco.MjModel) -> None:
    """Refuse options of a file that would silently change the simulation of a walking robot."""
    check_alone("xml_file", model, a1.TRUNK)
    if not np.allclose(model.opt.gravity, (0.0, 0.0, -GRAVITY)):
        raise RobotModelError(
            f"xml_file: got gravity {model.opt.gravity.tolist()}, expected [0, 0, {-GRAVITY}]"
        )
    if model.neq or model.ntendon or model.body_gravcomp.any():
        raise RobotModelError(
            f"xml_file: got {model.neq} equality constraint(s), {model.ntendon} tendon(s) and "
            f"gravity compensation {model.body_gravcomp.tolist()}, expected none"
        )
    medium = [model.opt.density, model.opt.viscosity, *model.opt.wind]
    if np.any(medium):
        raise RobotModelError(
            f"xml_file: got density, viscosity and wind {medium}, expected still thin air: zeros"
        )
    # name → values, and those of them that have to be zero
    losses = {
        "damping": (model.dof_damping, model.dof_damping[:6]),
        "frictionloss": (model.dof_frictionloss, model.dof_frictionloss[:6]),
        "armature": (model.dof_armature, model.dof_armature[:6]),
        "stiffness": (model.jnt_stiffness, model.jnt_stiffness),
        "mass": (model.body_mass, ()),
    }
    for name, (values, zeros) in losses.items():
        if not np.isfinite(values).all() or (values < 0.0).any() or np.any(zeros):
            raise RobotModelError(
                f"xml_file: got {name} {values.tolist()}, expected finite numbers not below 0, "
                "and neither losses of the free joint nor springs"
            )


def _foot_geom(model: mujoco.MjModel, leg: str) -> int:
    """Return the geom of a leg's foot, the lowest sphere of its calf that collides."""
    calf = model.jnt_bodyid[model.joint(f"{leg}_calf_joint").id]
    on_calf = (model.geom_bodyid == calf) & (model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE)
    spheres = np.flatnonzero(on_calf & (model.geom_contype > 0))
    if not len(spheres):
        raise RobotModelError(
            f"xml_file: got no sphere that collides in body {model.body(calf).name!r}, "
            "expected one as the foot"
        )
    return int(spheres[model.geom_pos[spheres, 2].argmin()])


def _foot(model: mujoco.MjModel, feet: list[int]) -> tuple[float, float]:
    """Return the calf's length and the foot's radius [m], which all legs have to share."""
    places = model.geom_pos[feet]
    radii = model.geom_size[feet, 0]
    are_below_knees = np.allclose(places[:, :2], 0.0, atol=1e-4) and (places[:, 2] < 0.0).all()
    are_equal = np.allclose(places[:, 2], places[0, 2]) and np.allclose(radii, radii[0])
    if not (are_below_knees and are_equal):
        raise RobotModelError(
            f"xml_file: got feet at {places.tolist()} in the calf's axes and of radii "
            f"{radii.tolist()} m, expected all alike and straight below the knee"
        )
    return float(-places[0, 2]), float(radii[0])


def _stall_torque(model: mujoco.MjModel) -> Array:
    """Return the torque limits (12,) of the joints [N·m]."""
    limits = np.full(12, np.nan)
    for index, name in enumerate(a1.JOINTS):
        joint = model.joint(name).id
        acts_on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
        for actuator in np.flatnonzero(acts_on_joint & (model.actuator_trnid[:, 0] == joint)):
            limits[index] = actuator_limit(model, int(actuator))
            if model.jnt_actfrclimited[joint] and not model.actuator_forcelimited[actuator]:
                limits[index] = np.abs(model.jnt_actfrcrange[joint]).min()
    if not (np.isfinite(limits).all() and (limits > 0.0).all()):
        raise RobotModelError(
            f"xml_file: got the torque limits {limits.tolist()} N·m, expected a positive one for "
            "every joint: an actuator's forcerange, a joint's actuatorfrcrange or a motor's "
            "ctrlrange"
        )
    return limits


def _no_load_speed(model: mujoco.MjModel) -> Array:
    """Return the no-load speeds (12,) of the joints [rad/s], infinite if the file has none."""
    names = [model.numeric(i).name for i in range(model.nnumeric)]
    if "no_load_speed" not in names:
        return np.full(12, np.inf)
    data = np.array(model.numeric("no_load_speed").data, dtype=np.float64)
    if len(data) not in (1, 3, 12) or not np.isfinite(data).all() or (data <= 0.0).any():
        raise RobotModelError(
            f"xml_file: got no_load_speed {data.tolist()}, expected 1 positive number, 3 (abad, "
            "hip, knee) or 12 [rad/s]"
        )
    return np.tile(data, 12 // len(data))


def _home(model: mujoco.MjModel) -> tuple[Array, float]:
    """Return the joints (12,) [rad] and the height of the key "home", or the default and 0 [m]."""
    joints = np.tile(_DEFAULT_LEG, 4)
    height = 0.0
    if "home" in [model.key(i).name for i in range(model.nkey)]:
        qpos = model.key("home").qpos
        height = float(qpos[2])
        joints = np.array(qpos[7:19])
    low, high = model.jnt_range[1:].T
    is_limited = model.jnt_limited[1:] > 0
    is_outside = is_limited & ((joints < low) | (joints > high))
    if not np.isfinite(joints).all() or is_outside.any():
        raise RobotModelError(
            f"xml_file: got the home joints {joints.tolist()}, expected them within the ranges "
            f"{model.jnt_range[1:].tolist()}"
        )
    return joints, height


def _standing_height(model: mujoco.MjModel, joints: Array, feet: list[int]) -> float:
    """Return the trunk's height at which the lowest sole is `CLEARANCE` above the ground [m]."""
    data = mujoco.MjData(model)
    data.qpos[:7] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    data.qpos[7:] = joints
    mujoco.mj_kinematics(model, data)
    return float((model.geom_size[feet, 0] - data.geom_xpos[feet, 2]).max()) + CLEARANCE


def _check_strength(model: mujoco.MjModel, robot: Quadruped) -> None:
    """Refuse a robot whose knees could not carry it on two legs in its home pose."""
    weight = GRAVITY * float(model.body_subtreemass[model.body(a1.TRUNK).id])
    _, hip, knee = robot.home_joints.reshape(4, 3).T
    lever = robot.calf * np.abs(np.sin(hip + knee)).max()  # horizontal, from the knee to the foot
    needed = 0.5 * weight * lever
    weakest = float(robot.stall_torque[2::3].min())  # of the knees
    if needed > weakest:
        raise RobotModelError(
            f"xml_file: got a robot of {weight / GRAVITY:.3g} kg whose knees give {weakest:.3g} "
            f"N·m, expected at least the {needed:.3g} N·m that carry it on two legs at home"
        )
