"""What a robot is, read by rule from its MJCF file: no number of the A1's is assumed of another."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.errors import RobotModelError
from hcbf_gym.models.constants import GRAVITY
from hcbf_gym.robots import a1

CLEARANCE = 0.001  # between soles and ground where the home pose's height is solved [m]

_DEFAULT_LEG = (0.0, 0.9, -1.8)  # [rad] abad, hip and knee where a file has no home pose


@dataclass(frozen=True)
class Quadruped:
    """A trunk with four abad–hip–knee legs, joints ordered as in `a1.JOINTS`.

    Attributes:
        xml_file: where it was read from.
        calf: knee to the centre of the foot's sphere [m].
        foot_radius: of that sphere [m].
        stall_torque: (12,) what the joints' motors give at rest [N·m].
        no_load_speed: (12,) at which they give nothing [rad/s]; infinite where the file has no
            ``<custom><numeric name="no_load_speed"/>``.
        home_joints: (12,) of the key "home", or 0, 0.9 and −1.8 on each leg [rad].
        home_height: of the trunk's origin above flat ground at home, soles clear of it [m].
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
    """Return the compiled model.

    Raises:
        RobotModelError: if MuJoCo refuses it: a missing mesh, a mass that is none, …
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise RobotModelError(f"xml_file: MuJoCo refuses {source}: {error}") from error


def read_robot(xml_file: str | Path = a1.XML_FILE) -> Quadruped:
    """Read a robot by rule and check that the controller can drive it.

    Legs are found by the names of `a1.JOINTS`; the foot is the lowest sphere of a calf; a torque
    limit is the actuator's force range, else the joint's ``actuatorfrcrange``, else the control
    range of a motor.

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
    """Refuse a file, named `what`, with bodies or geoms besides the robot by a RobotModelError."""
    alone = model.body_rootid == model.body(trunk).id
    strangers = [model.body(i).name for i in np.flatnonzero(~alone[1:]) + 1]
    ground = int((model.geom_bodyid == 0).sum())
    if strangers or ground:
        raise RobotModelError(
            f"{what}: got {ground} geom(s) in the world and the bodies {strangers} besides the "
            "robot, expected the robot alone: the simulation adds floor and obstacles"
        )


def actuator_limit(model: mujoco.MjModel, actuator: int) -> float:
    """Return what an actuator gives at most [N·m]; infinite where it has no limit.

    It is its force range, else the control range of a motor.
    """
    gear = abs(model.actuator_gear[actuator, 0])
    if model.actuator_forcelimited[actuator]:
        return float(gear * np.abs(model.actuator_forcerange[actuator]).min())
    motor = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
    if motor and model.actuator_ctrllimited[actuator]:
        gain = abs(model.actuator_gainprm[actuator, 0])
        return float(gear * gain * np.abs(model.actuator_ctrlrange[actuator]).min())
    return np.inf


def foot_name(leg: str) -> str:
    """Return the name that the simulation gives to a leg's foot."""
    return f"{leg}_foot"


def _check_tree(model: mujoco.MjModel) -> None:
    names = [model.joint(i).name for i in range(model.njnt)]
    hinges = [n for n, t in zip(names, model.jnt_type, strict=True) if t == 3]
    if hinges != list(a1.JOINTS) or len(names) != 13 or (model.jnt_type == 0).sum() != 1:
        raise RobotModelError(
            f"xml_file: got {len(names) - len(hinges)} joint(s) besides the hinges {hinges}, "
            f"expected one free joint and the hinges {list(a1.JOINTS)}"
        )
    bodies = [model.body(i).name for i in range(model.nbody)]
    if a1.TRUNK not in bodies:
        raise RobotModelError(f"xml_file: got the bodies {bodies}, expected one named {a1.TRUNK!r}")
    free = model.jnt_bodyid[model.jnt_type == 0][0]
    if bodies[free] != a1.TRUNK or model.body_parentid[free] != 0:
        raise RobotModelError(
            f"xml_file: got the free joint in body {bodies[free]!r}, expected it in {a1.TRUNK!r}, "
            "a child of the world"
        )
    parents = [names[model.body_jntadr[model.body_parentid[b]]] for b in model.jnt_bodyid[1:]]
    expected = [names[0] if i % 3 == 0 else a1.JOINTS[i - 1] for i in range(12)]
    if parents != expected:
        raise RobotModelError(
            f"xml_file: got joints that hang from {parents}, expected each leg's hip at the trunk, "
            "its thigh at the hip and its calf at the thigh"
        )


def _check_plausible(model: mujoco.MjModel) -> None:
    """Refuse what would silently turn the simulation into something else than a robot walking."""
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
    losses = {
        "damping": model.dof_damping,
        "frictionloss": model.dof_frictionloss,
        "armature": model.dof_armature,
        "stiffness": model.jnt_stiffness,
        "mass": model.body_mass,
    }
    for name, values in losses.items():
        free = name != "mass" and np.any(values[: 6 if name != "stiffness" else 1])
        springs = name == "stiffness" and np.any(values)
        if not np.isfinite(values).all() or (values < 0.0).any() or free or springs:
            raise RobotModelError(
                f"xml_file: got {name} {values.tolist()}, expected finite numbers not below 0, "
                "and neither losses of the free joint nor springs"
            )


def _foot_geom(model: mujoco.MjModel, leg: str) -> int:
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
    """Return the calf's length and the foot's radius [m]."""
    places = model.geom_pos[feet]
    radii = model.geom_size[feet, 0]
    straight = np.allclose(places[:, :2], 0.0, atol=1e-4) and (places[:, 2] < 0.0).all()
    equal = np.allclose(places[:, 2], places[0, 2]) and np.allclose(radii, radii[0])
    if not (straight and equal):
        raise RobotModelError(
            f"xml_file: got feet at {places.tolist()} in the calf's axes and of radii "
            f"{radii.tolist()} m, expected all alike and straight below the knee"
        )
    return float(-places[0, 2]), float(radii[0])


def _stall_torque(model: mujoco.MjModel) -> Array:
    limits = np.full(12, np.nan)
    for index, name in enumerate(a1.JOINTS):
        joint = model.joint(name).id
        driven = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (
            model.actuator_trnid[:, 0] == joint
        )
        for actuator in np.flatnonzero(driven):
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
    """Return the joints of the home pose [rad] and the height that its key gives, else 0 [m]."""
    joints = np.tile(_DEFAULT_LEG, 4)
    height = 0.0
    if "home" in [model.key(i).name for i in range(model.nkey)]:
        qpos = model.key("home").qpos
        height = float(qpos[2])
        joints = np.array(qpos[7:19])
    low, high = model.jnt_range[1:].T
    limited = model.jnt_limited[1:] > 0
    outside = limited & ((joints < low) | (joints > high))
    if not np.isfinite(joints).all() or outside.any():
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
    legs = robot.home_joints.reshape(4, 3)
    lever = robot.calf * np.abs(np.sin(legs[:, 1] + legs[:, 2])).max()
    needed = 0.5 * weight * lever
    least = float(robot.stall_torque[2::3].min())
    if needed > least:
        raise RobotModelError(
            f"xml_file: got a robot of {weight / GRAVITY:.3g} kg whose knees give {least:.3g} N·m, "
            f"expected at least the {needed:.3g} N·m that carry it on two legs at home"
        )
