"""A walker's MJCF as the contract changes it: checked, its actuators found by name."""

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

_DRIVEN = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_VISIBLE_GROUPS = 3  # groups of geoms that MuJoCo draws


@dataclass(frozen=True)
class Parts:
    """Names in the file, as the contract or the file orders them."""

    trunk: str  # the body that floats
    # the driven joints in the order of the controller's output; empty where actuators drive none
    joints: tuple[str, ...]
    actuators: tuple[str, ...]  # in the order of the controller's output
    home: Array  # (j,) of every hinge and slide in the file's order [rad]


@dataclass(frozen=True)
class Indices:
    """Where a compiled scene has what the controller reads and drives."""

    q: Integers  # (k,) of the driven joints in qpos
    rate: Integers  # (k,) of them in qvel
    ctrl: Integers  # (k,) of the actuators in ctrl


def walker_spec(
    mjcf: Path, body: Body, action: Action, physics: Physics, sensors: set[str]
) -> tuple[mujoco.MjSpec, Parts]:
    """Return the robot alone, as the contract changes it, and the names of its parts.

    Of the file's sensors those that are not read are left out, as each costs time.

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
    have = [sensor.name for sensor in spec.sensors]
    for name in sorted(sensors - set(have)):
        raise RobotModelError(f"mjcf: got no sensor {name!r}, expected one of {have}")
    for sensor in [sensor for sensor in spec.sensors if sensor.name not in sensors]:
        spec.delete(sensor)
    _set_physics(spec, physics, joints)
    if action.gains is not None:
        _add_servos(spec, model, action.gains, joints)
        actuators = joints
    _show(spec)
    return spec, Parts(trunk, joints, actuators, home)


def indices(model: mujoco.MjModel, parts: Parts) -> Indices:
    """Return where a compiled scene has the parts."""
    joints = [model.joint(name).id for name in parts.joints]
    return Indices(
        model.jnt_qposadr[joints].astype(np.int64),
        model.jnt_dofadr[joints].astype(np.int64),
        np.array([model.actuator(name).id for name in parts.actuators], dtype=np.int64),
    )


def as_slice(places: Integers) -> slice | Integers:
    """Return places as a slice where they follow each other, which is a view and faster."""
    first = int(places[0]) if len(places) else 0
    follow = np.array_equal(places, first + np.arange(len(places)))
    return slice(first, first + len(places)) if follow else places


def _trunk(model: mujoco.MjModel, body: Body) -> str:
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
    """Refuse what would turn the simulation into something else than one robot on the ground."""
    check_alone("mjcf", model, trunk)
    if not np.allclose(model.opt.gravity, (0.0, 0.0, -GRAVITY), atol=0.01):
        raise RobotModelError(
            f"mjcf: got gravity {model.opt.gravity.tolist()}, expected [0, 0, {-GRAVITY}]"
        )
    masses = model.body_mass
    if not (np.isfinite(masses).all() and masses.sum() > 0.0):
        raise RobotModelError(f"mjcf: got the masses {masses.tolist()}, expected a robot's")


def _driven(model: mujoco.MjModel, action: Action) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the driven joints and of their actuators, in the output's order."""
    known = [model.actuator(i).name for i in range(model.nu)]
    if action.actuators is not None:
        missing = [name for name in action.actuators if name not in known]
        if missing:
            raise RobotModelError(f"action: got no actuators {missing}, expected among {known}")
        return (), action.actuators
    hinges = [model.joint(i).name for i in range(model.njnt) if int(model.jnt_type[i]) in _DRIVEN]
    joints = tuple(hinges) if action.joints is None else action.joints
    missing = [name for name in joints if name not in hinges]
    if missing or not joints:
        raise RobotModelError(f"action: got no joints {missing}, expected among {hinges}")
    by_joint: dict[int, str] = {}
    for i in np.flatnonzero(model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT):
        joint = int(model.actuator_trnid[i, 0])
        if joint in by_joint:
            raise RobotModelError(
                f"action: got two actuators at {model.joint(joint).name!r}, expected one"
            )
        by_joint[joint] = known[i]
    without = [name for name in joints if not by_joint.get(model.joint(name).id)]
    if without:
        raise RobotModelError(
            f"action: got no named actuator at the joints {without}, expected one at each"
        )
    return joints, tuple(by_joint[model.joint(name).id] for name in joints)


def _home(model: mujoco.MjModel, action: Action, joints: tuple[str, ...]) -> Array:
    """Return (j,) the start of every hinge and slide in the file's order."""
    home = np.array(model.qpos0[7:])
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
        home[model.jnt_qposadr[joint] - 7] = value
    return home


def _set_physics(spec: mujoco.MjSpec, physics: Physics, joints: tuple[str, ...]) -> None:
    option = spec.option
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a divergence is reported
    if physics.cone is not None:
        option.cone = getattr(mujoco.mjtCone, f"mjCONE_{physics.cone.upper()}")
    _set(option, physics, ("timestep", "impratio"))
    for name in joints:
        _set(spec.joint(name), physics, ("armature", "damping", "frictionloss"))


def _set(element: Any, physics: Physics, names: tuple[str, ...]) -> None:
    """Set attributes to the contract's values; where MuJoCo has an array, its first entry."""
    for name in names:
        value, before = getattr(physics, name), getattr(element, name)
        if value is not None:
            one = np.ndim(before) == 0
            setattr(element, name, value if one else np.eye(1, len(before))[0] * value)


def _add_servos(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    gains: Mapping[str, tuple[float, ...]],
    joints: tuple[str, ...],
) -> None:
    """Replace the file's actuators by position servos that keep their torque limits."""
    kp = spread("action: gains: kp", gains["kp"], len(joints))
    kd = spread("action: gains: kd", gains["kd"], len(joints))
    limits = [_limit(model, name) for name in joints]
    for actuator in spec.actuators:
        spec.delete(actuator)
    for k, name in enumerate(joints):
        servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=kp[k], kv=kd[k])
        servo.ctrllimited = False
        if np.isfinite(limits[k]):
            servo.forcelimited = True
            servo.forcerange = (-limits[k], limits[k])


def _limit(model: mujoco.MjModel, name: str) -> float:
    """Return what a joint's actuator gives at most [N·m]; infinite where the file has no limit."""
    joint = model.joint(name).id
    drives = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (
        model.actuator_trnid[:, 0] == joint
    )
    return actuator_limit(
        model, int(np.flatnonzero(drives)[0])
    )  # its actuatorfrcrange holds anyhow


def _show(spec: mujoco.MjSpec) -> None:
    """Draw what collides where the file has no meshes to be drawn."""
    if not any(geom.type == mujoco.mjtGeom.mjGEOM_MESH for geom in spec.geoms):
        for geom in spec.geoms:
            geom.group = min(geom.group, _VISIBLE_GROUPS - 1)
