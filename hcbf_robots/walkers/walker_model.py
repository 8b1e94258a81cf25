"""Checks a walker's MJCF, changes it as the contract requires, and finds its parts by name."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from hcbf_gym.arrays import Array, Integers
from hcbf_gym.errors import InvalidInputError, RobotModelError
from hcbf_gym.models.constants import GRAVITY
from hcbf_gym.robots.reader import actuator_limit, check_alone, compile_spec, load_spec
from hcbf_robots.walkers.walker_parts import Action, Body, Physics, spread

_SCALAR_JOINTS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
FREE_JOINT_SIZE = 7  # entries of the free joint in qpos, before those of the other joints
_LAST_VISIBLE_GROUP = 2  # MuJoCo draws the groups 0, 1 and 2 of geoms


@dataclass(frozen=True)
class Parts:
    """The names of a walker's parts in its file, and the home position of its joints."""

    trunk: str  # the body with the free joint
    # (k,) driven joints in the order of the controller's output; empty if actuators have no joint
    joints: tuple[str, ...]
    actuators: tuple[str, ...]  # (k,) in the order of the controller's output
    home: Array  # (j,) position of every hinge and slide, in the file's order [rad, m]


@dataclass(frozen=True)
class Indices:
    """The indices of a walker's parts in the arrays of a compiled scene."""

    q: Integers  # (k,) the driven joints in qpos
    rate: Integers  # (k,) the driven joints in qvel
    ctrl: Integers  # (k,) the actuators in ctrl


def walker_spec(
    mjcf: Path, body: Body, action: Action, physics: Physics, sensors: set[str]
) -> tuple[mujoco.MjSpec, Parts]:
    """Return the robot alone, as the contract changes it, and the names of its parts.

    Only the named sensors are kept, because MuJoCo computes all of them at every step.

    Raises:
        RobotModelError: if the file cannot be read, is no single robot that floats, or lacks a
            joint, an actuator or a sensor.
        InvalidInputError: if home, scale or gains do not fit the driven joints.
    """
    model = compile_spec(load_spec(mjcf), mjcf)
    trunk = _trunk(model, body)
    _check_alone(model, trunk)
    joints, actuators = _driven(model, action)
    home = _home(model, action, joints)
    spec = load_spec(mjcf)
    for element in (*spec.keys, *spec.lights):  # the scene has lights, and keys would not fit it
        spec.delete(element)
    _keep_sensors(spec, sensors)
    _set_physics(spec, physics, joints)
    if action.gains is not None:
        _add_servos(spec, model, action.gains, joints)
        actuators = joints
    _show_collisions(spec)
    return spec, Parts(trunk, joints, actuators, home)


def indices(model: mujoco.MjModel, parts: Parts) -> Indices:
    """Return the indices of the parts in a compiled scene."""
    joints = [model.joint(name).id for name in parts.joints]
    return Indices(
        model.jnt_qposadr[joints].astype(np.int64),
        model.jnt_dofadr[joints].astype(np.int64),
        np.array([model.actuator(name).id for name in parts.actuators], dtype=np.int64),
    )


def as_slice(places: Integers) -> slice | Integers:
    """Return consecutive indices as a slice, which reads a view without a copy; others as given."""
    first = int(places[0]) if len(places) else 0
    is_consecutive = np.array_equal(places, first + np.arange(len(places)))
    return slice(first, first + len(places)) if is_consecutive else places


def _trunk(model: mujoco.MjModel, body: Body) -> str:
    """Return the name of the one body that floats."""
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    names = [model.body(model.jnt_bodyid[j]).name for j in free]
    if len(free) != 1 or model.body_parentid[model.jnt_bodyid[free[0]]] != 0 or free[0] != 0:
        raise RobotModelError(
            f"mjcf: got free joints at the bodies {names}, expected one, at the first body of the "
            "world: a robot that floats"
        )
    if not names[0]:
        raise RobotModelError("mjcf: got a body without a name, expected one at the free joint")
    if body.trunk not in (None, names[0]):
        raise RobotModelError(
            f"body: trunk: got {body.trunk!r}, expected {names[0]!r}, where the free joint is"
        )
    return names[0]


def _check_alone(model: mujoco.MjModel, trunk: str) -> None:
    """Refuse files with more than one robot, other gravity, or no mass."""
    check_alone("mjcf", model, trunk)
    if not np.allclose(model.opt.gravity, (0.0, 0.0, -GRAVITY), atol=0.01):
        raise RobotModelError(
            f"mjcf: got gravity {model.opt.gravity.tolist()}, expected [0, 0, {-GRAVITY}]"
        )
    masses = model.body_mass
    if not (np.isfinite(masses).all() and masses.sum() > 0.0):
        raise RobotModelError(f"mjcf: got the masses {masses.tolist()}, expected a robot's")


def _driven(model: mujoco.MjModel, action: Action) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the driven joints, and of the actuators, in the output's order."""
    if action.actuators is not None:
        known = [model.actuator(i).name for i in range(model.nu)]
        missing = [name for name in action.actuators if name not in known]
        if missing:
            raise RobotModelError(f"action: got no actuators {missing}, expected among {known}")
        return (), action.actuators
    scalar_joints = [
        model.joint(i).name for i in range(model.njnt) if int(model.jnt_type[i]) in _SCALAR_JOINTS
    ]
    joints = tuple(scalar_joints) if action.joints is None else action.joints
    missing = [name for name in joints if name not in scalar_joints]
    if missing or not joints:
        raise RobotModelError(f"action: got no joints {missing}, expected among {scalar_joints}")
    actuators = {model.joint(k).name: model.actuator(i).name for k, i in _at_joints(model).items()}
    without = [name for name in joints if not actuators.get(name)]
    if without:
        raise RobotModelError(
            f"action: got no named actuator at the joints {without}, expected one at each"
        )
    return joints, tuple(actuators[name] for name in joints)


def _at_joints(model: mujoco.MjModel) -> dict[int, int]:
    """Return joint → the actuator that drives it, by their indices; refuse two at one joint."""
    actuators: dict[int, int] = {}
    for i in np.flatnonzero(model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT).tolist():
        joint = int(model.actuator_trnid[i, 0])
        if joint in actuators:
            raise RobotModelError(
                f"action: got two actuators at {model.joint(joint).name!r}, expected one"
            )
        actuators[joint] = i
    return actuators


def _home(model: mujoco.MjModel, action: Action, joints: tuple[str, ...]) -> Array:
    """Return (j,) the start position of every hinge and slide, in the file's order."""
    home = np.array(model.qpos0[FREE_JOINT_SIZE:])
    if len(home) != model.njnt - 1:
        raise RobotModelError("mjcf: got a ball joint, expected hinges and slides alone")
    if action.home is None:
        return home
    if len(action.home) != len(joints):
        raise InvalidInputError(
            f"action: home: got {len(action.home)} numbers, expected one for each of the "
            f"{len(joints)} joints {list(joints)}"
        )
    for name, value in zip(joints, action.home, strict=True):
        joint = model.joint(name).id
        low, high = model.jnt_range[joint].tolist()
        if model.jnt_limited[joint] and not low <= value <= high:
            raise InvalidInputError(
                f"action: home: got {value} for {name!r}, expected from {low:g} to {high:g}"
            )
        home[model.jnt_qposadr[joint] - FREE_JOINT_SIZE] = value
    return home


def _keep_sensors(spec: mujoco.MjSpec, names: set[str]) -> None:
    """Delete all sensors but the named ones, and refuse names that the file lacks."""
    known = [sensor.name for sensor in spec.sensors]
    for name in sorted(names - set(known)):
        raise RobotModelError(f"mjcf: got no sensor {name!r}, expected one of {known}")
    for sensor in [sensor for sensor in spec.sensors if sensor.name not in names]:
        spec.delete(sensor)


def _set_physics(spec: mujoco.MjSpec, physics: Physics, joints: tuple[str, ...]) -> None:
    """Set the options and the joints to the contract's values."""
    option = spec.option
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a divergence is reported
    if physics.cone is not None:
        option.cone = getattr(mujoco.mjtCone, f"mjCONE_{physics.cone.upper()}")
    _set(option, physics, ("timestep", "impratio"))
    for name in joints:
        _set(spec.joint(name), physics, ("armature", "damping", "frictionloss"))


def _set(element: Any, physics: Physics, names: tuple[str, ...]) -> None:
    """Set attributes to the contract's values, but for those that it leaves out."""
    for name in names:
        value, before = getattr(physics, name), getattr(element, name)
        if value is None:
            continue
        if np.ndim(before) > 0:  # of damping MuJoCo has the coefficients of a polynomial
            value = np.array([value] + [0.0] * (len(before) - 1))
        setattr(element, name, value)


def _add_servos(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    gains: Mapping[str, tuple[float, ...]],
    joints: tuple[str, ...],
) -> None:
    """Replace the file's actuators by position servos with the same torque limits."""
    kp = spread("action: gains: kp", gains["kp"], len(joints))
    kd = spread("action: gains: kd", gains["kd"], len(joints))
    actuators = _at_joints(model)  # the joints' own actuatorfrcrange is not touched
    limits = [actuator_limit(model, actuators[model.joint(name).id]) for name in joints]
    for actuator in spec.actuators:
        spec.delete(actuator)
    for k, name in enumerate(joints):
        servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=kp[k], kv=kd[k])
        servo.ctrllimited = False
        if np.isfinite(limits[k]):
            servo.forcelimited = True
            servo.forcerange = (-limits[k], limits[k])


def _show_collisions(spec: mujoco.MjSpec) -> None:
    """Let MuJoCo draw the geoms that collide, in a file that has no meshes to draw."""
    if not any(geom.type == mujoco.mjtGeom.mjGEOM_MESH for geom in spec.geoms):
        for geom in spec.geoms:
            geom.group = min(geom.group, _LAST_VISIBLE_GROUP)
