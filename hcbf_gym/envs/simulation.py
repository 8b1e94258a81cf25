"""The plant: the robot, a floor and boxes in MuJoCo, stepped one physics tick at a time."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hcbf_gym.errors import RobotModelError, finite_float
from hcbf_gym.locomotion.state import Array, RobotState
from hcbf_gym.robots import a1

MIN_UPRIGHT = 0.5  # cosine of the trunk's tilt below which it has fallen
MIN_HEIGHT = 0.12  # [m] of the trunk below which it has fallen

FIXED_BOX_RGBA = (0.55, 0.42, 0.30, 1.0)
LIGHT_BOX_RGBA = (0.95, 0.80, 0.15, 1.0)


class Simulation:
    """A scene with one robot, driven by joint torques.

    Args:
        xml_file: MJCF of the robot alone; None means the package's own A1. Its actuators are
            replaced by torque motors.
        timestep: of the physics [s].
        obstacles: records with ``name``, ``center`` (2,) [m], ``size`` (3,) full edges [m], ``yaw``
            [rad] and ``mass`` [kg], None for a fixed box.
        floor_friction: Coulomb friction of the feet's contacts.
        decorate: called with the MjSpec before it is compiled, to add things that are only seen.

    Raises:
        RobotModelError: if the robot has not the A1's trunk, joints and feet.
        InvalidInputError: on a number out of range.
    """

    def __init__(
        self,
        xml_file: str | Path | None = None,
        *,
        timestep: float = 0.002,
        obstacles: Sequence[Any] = (),
        floor_friction: float = 0.8,
        decorate: Callable[[mujoco.MjSpec], None] | None = None,
    ) -> None:
        timestep = finite_float("timestep", timestep, minimum=0.0, exclusive=True)
        friction = finite_float("floor_friction", floor_friction, minimum=0.0, exclusive=True)
        spec = _robot(Path(xml_file or a1.XML_FILE))
        _set_physics(spec, timestep)
        _add_floor(spec)
        for obstacle in obstacles:
            _add_box(spec, obstacle)
        if decorate is not None:
            decorate(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)

        model = self.model
        self._trunk = model.body(a1.TRUNK).id
        free = model.joint(int(model.body_jntadr[self._trunk]))
        hinges = [model.joint(name) for name in a1.JOINTS]
        self._free_q, self._free_v = int(free.qposadr[0]), int(free.dofadr[0])
        self._joint_q = np.array([joint.qposadr[0] for joint in hinges])
        self._joint_v = np.array([joint.dofadr[0] for joint in hinges])
        self._feet = np.array([_foot_geom(model, leg) for leg in a1.LEGS])
        model.geom_friction[self._feet, 0] = friction

    def reset(self, position: Array, yaw: float, rng: np.random.Generator) -> None:
        """Put the robot at rest on its feet at `position` (2,) [m], facing `yaw` [rad].

        Args:
            position: (2,) [m].
            yaw: [rad].
            rng: draws what is random about this episode.
        """
        mujoco.mj_resetData(self.model, self.data)
        qpos = self.data.qpos
        i = self._free_q
        qpos[i : i + 2] = position
        qpos[i + 2] = a1.HOME_HEIGHT
        qpos[i + 3 : i + 7] = np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)
        qpos[self._joint_q] = a1.HOME_JOINTS
        mujoco.mj_step1(self.model, self.data)

    def state(self) -> RobotState:
        """Return what the robot's sensors and its estimator say now."""
        qpos, qvel = self.data.qpos.copy(), self.data.qvel.copy()
        i, j = self._free_q, self._free_v
        return RobotState(
            position=qpos[i : i + 3],
            quaternion=qpos[i + 3 : i + 7],
            linear_velocity=qvel[j : j + 3],
            angular_velocity=qvel[j + 3 : j + 6],
            joint_position=qpos[self._joint_q],
            joint_velocity=qvel[self._joint_v],
            foot_contact=self._foot_contact(),
        )

    def step(self, torque: Array) -> None:
        """Advance the physics by one tick under the joint torques (12,) [N·m].

        The tick ends with `mj_step1`, so that positions, velocities and contacts are those of the
        new time when the controller reads them.
        """
        self.data.ctrl[:] = torque
        mujoco.mj_step2(self.model, self.data)
        mujoco.mj_step1(self.model, self.data)

    def push(self, force: Array) -> None:
        """Pull at the trunk's centre of mass with a force (3,) [N] from now on; zeros end it."""
        self.data.xfrc_applied[self._trunk, :3] = force

    @property
    def base_position(self) -> Array:
        """(2,) of the trunk [m]."""
        return self.data.qpos[self._free_q : self._free_q + 2].copy()

    @property
    def base_velocity(self) -> Array:
        """(2,) of the trunk [m/s]."""
        return self.data.qvel[self._free_v : self._free_v + 2].copy()

    @property
    def fallen(self) -> bool:
        """Whether the trunk has tipped over or lies on the ground, or the physics diverged."""
        i = self._free_q
        z, _, x, y = self.data.qpos[i + 2 : i + 6]
        upright = 1.0 - 2.0 * (x * x + y * y)
        return not (upright > MIN_UPRIGHT and z > MIN_HEIGHT)

    def contacts_with(self, name: str) -> float:
        """Return the sum of the normal forces between the robot and an obstacle [N]."""
        obstacle = self.model.geom(name).id
        force, total = np.zeros(6), 0.0
        for index in np.flatnonzero((self.data.contact.geom == obstacle).any(axis=1)):
            other = int(self.data.contact.geom[index].sum()) - obstacle
            body = self.model.geom_bodyid[other]
            if self.model.body_rootid[body] == self._trunk:
                mujoco.mj_contactForce(self.model, self.data, int(index), force)
                total += force[0]
        return total

    def _foot_contact(self) -> NDArray[np.bool_]:
        touching = self.data.contact.geom.ravel()
        return (self._feet[:, None] == touching).any(axis=1)


def _robot(xml_file: Path) -> mujoco.MjSpec:
    if not xml_file.is_file():
        raise RobotModelError(f"xml_file: got {str(xml_file)!r}, expected an existing MJCF file")
    try:
        spec = mujoco.MjSpec.from_file(str(xml_file))
    except ValueError as error:
        raise RobotModelError(f"xml_file: MuJoCo refuses {xml_file}: {error}") from error
    joints = {joint.name for joint in spec.joints}
    missing = [name for name in a1.JOINTS if name not in joints]
    if missing or spec.body(a1.TRUNK) is None:
        raise RobotModelError(
            f"xml_file: got the joints {sorted(joints)}, expected a body {a1.TRUNK!r} and the "
            f"joints {list(a1.JOINTS)}; missing are {missing}"
        )
    for element in (*spec.actuators, *spec.keys):  # keys would no longer fit the scene's qpos
        spec.delete(element)
    for name in a1.JOINTS:
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.forcelimited = True
        motor.forcerange = (-a1.TORQUE_LIMIT, a1.TORQUE_LIMIT)
    return spec


def _set_physics(spec: mujoco.MjSpec, timestep: float) -> None:
    option = spec.option
    option.timestep = timestep
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 100.0
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a divergence is reported


def _add_floor(spec: mujoco.MjSpec) -> None:
    spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 0.05), rgba=(0.8, 0.8, 0.8, 1)
    )
    spec.worldbody.add_light(
        pos=(0, 0, 4), dir=(0.2, 0.2, -1), type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    )


def _add_box(spec: mujoco.MjSpec, obstacle: Any) -> None:
    half = 0.5 * np.asarray(obstacle.size)
    body = spec.worldbody.add_body(
        name=obstacle.name,
        pos=(*obstacle.center, half[2]),
        quat=(np.cos(obstacle.yaw / 2), 0, 0, np.sin(obstacle.yaw / 2)),
    )
    geom = body.add_geom(
        name=obstacle.name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=half,
        rgba=FIXED_BOX_RGBA if obstacle.mass is None else LIGHT_BOX_RGBA,
    )
    if obstacle.mass is not None:
        geom.mass = obstacle.mass
        body.add_freejoint()


def _foot_geom(model: mujoco.MjModel, leg: str) -> int:
    """Return the sphere at the end of a leg."""
    calf = model.body(f"{leg}_calf")
    first = int(calf.geomadr[0])
    for geom in range(first, first + int(calf.geomnum[0])):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE:
            return geom
    raise RobotModelError(f"xml_file: got no sphere in body '{leg}_calf', expected one as the foot")
