"""The parts of a MuJoCo scene: robot, physics, ground, boxes and payload, added to an MjSpec."""

from collections.abc import Sequence

import mujoco
import numpy as np

from hcbf_gym.drawing import palette
from hcbf_gym.errors import InvalidInputError, choose
from hcbf_gym.models.constants import GRAVITY
from hcbf_gym.robots import a1
from hcbf_gym.robots.reader import Quadruped, foot_name, load_spec
from hcbf_gym.scenarios import BoxObstacle

FIXED_BOX_RGBA = palette.rgba(palette.FIXED_BOX)
LIGHT_BOX_RGBA = palette.rgba(palette.LIGHT_BOX)
TILE = 0.5  # edge of a square of the floor's pattern [m]

FLOOR = "floor"
_NET_FORCE = 3  # a contact sensor's reduction: the contacts' sum, in the world's axes

ROUGH_STEP = 0.03  # the highest step of rough ground [m]
ROUGH_BLOCK = 0.25  # edge of a block of one height [m]
ROUGH_CELL = 0.05  # distance over which one block rises to the next [m]
ROUGH_HALF_SIZE = 20.0  # half the edge of the field, centred at the origin, within walls [m]
WALL_HEIGHT = 0.5  # [m]

PAYLOAD = "payload"
PAYLOAD_HALF_SIZE = (0.06, 0.05, 0.04)  # [m]


def robot_spec(robot: Quadruped) -> mujoco.MjSpec:
    """Return the robot alone, with torque motors, and feet with names and contact sensors."""
    spec = load_spec(robot.xml_file)
    # key frames would not fit the scene's number of joints
    for element in (*spec.actuators, *spec.keys, *spec.sensors):
        spec.delete(element)
    for name, limit in zip(a1.JOINTS, robot.stall_torque.tolist(), strict=True):
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.forcelimited = True
        motor.forcerange = (-limit, limit)
    for leg in a1.LEGS:
        _add_foot_sensor(spec, leg)
    return spec


def _add_foot_sensor(spec: mujoco.MjSpec, leg: str) -> None:
    """Let the simulation report the net force between a foot and the floor."""
    calf = spec.joint(f"{leg}_calf_joint").parent
    sphere = mujoco.mjtGeom.mjGEOM_SPHERE
    spheres = [geom for geom in calf.geoms if geom.type == sphere and geom.contype]
    foot = min(spheres, key=lambda geom: geom.pos[2])
    foot.name = foot_name(leg)
    spec.add_sensor(
        name=foot.name,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_GEOM,
        objname=foot.name,
        reftype=mujoco.mjtObj.mjOBJ_GEOM,
        refname=FLOOR,
        intprm=(1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), _NET_FORCE, 1),
    )


def set_physics(spec: mujoco.MjSpec, timestep: float) -> None:
    """Choose integrator and contact model: stiff feet that neither creep nor sink."""
    option = spec.option
    option.timestep = timestep
    option.gravity = (0.0, 0.0, -GRAVITY)
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 100.0
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND  # one robot is one island


def add_ground(spec: mujoco.MjSpec, terrain: str, floor_decides: bool) -> None:
    """Add the ground and its light.

    Args:
        spec: the scene.
        terrain: "flat", a plane without end, or "rough", always the same blocks of random height up
            to `ROUGH_STEP`, between four walls.
        floor_decides: whether contacts have the floor's friction alone.
    """
    add = choose("terrain", terrain, {"flat": _add_plane, "rough": _add_rough_field})
    _add_floor_material(spec)
    add(spec)
    if floor_decides:
        floor = spec.geom(FLOOR)
        floor.priority, floor.condim = 1, 3
    spec.worldbody.add_light(
        pos=(0, 0, 4),
        dir=(0.2, 0.2, -1),
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        castshadow=False,  # shadows take half of a frame's time in software
    )


def _add_floor_material(spec: mujoco.MjSpec) -> None:
    """Add a chequered material, on which the robot's motion is visible."""
    spec.add_texture(
        name=FLOOR,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=palette.rgba(palette.FLOOR)[:3],
        rgb2=palette.rgba(palette.FLOOR_TILE)[:3],
        width=64,
        height=64,
    )
    repeat = (1 / TILE, 1 / TILE)
    material = spec.add_material(name=FLOOR, texuniform=True, texrepeat=repeat, specular=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = FLOOR


def _add_plane(spec: mujoco.MjSpec) -> None:
    """Add a plane without end."""
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    spec.worldbody.add_geom(name=FLOOR, type=plane, size=(0, 0, 0.05), material=FLOOR)


def _add_rough_field(spec: mujoco.MjSpec) -> None:
    """Add a field of blocks of random height, and four walls around it."""
    cells = round(ROUGH_BLOCK / ROUGH_CELL)
    blocks = round(2 * ROUGH_HALF_SIZE / ROUGH_BLOCK)
    heights = np.random.default_rng(0).random((blocks, blocks))
    field = np.kron(heights, np.ones((cells, cells)))
    spec.add_hfield(
        name=FLOOR,
        nrow=field.shape[0],
        ncol=field.shape[1],
        size=(ROUGH_HALF_SIZE, ROUGH_HALF_SIZE, ROUGH_STEP, 0.1),
        userdata=field.ravel(),
    )
    hfield = mujoco.mjtGeom.mjGEOM_HFIELD
    spec.worldbody.add_geom(name=FLOOR, type=hfield, hfieldname=FLOOR, material=FLOOR)
    far, half = ROUGH_HALF_SIZE, 0.5 * WALL_HEIGHT
    for x, y in ((far, 0.0), (-far, 0.0), (0.0, far), (0.0, -far)):
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=(x, y, half),
            size=(0.1 if x else far, 0.1 if y else far, half),
            rgba=FIXED_BOX_RGBA,
        )


def add_boxes(spec: mujoco.MjSpec, boxes: Sequence[BoxObstacle]) -> None:
    """Put boxes on the ground.

    Raises:
        InvalidInputError: if a box is named like another one or like a part of the scene.
    """
    taken = {PAYLOAD, *(part.name for part in (*spec.bodies, *spec.geoms) if part.name)}
    for box in boxes:
        if box.name in taken:
            raise InvalidInputError(
                f"obstacle: got the name {box.name!r}, expected one that is not among "
                f"{sorted(taken)}"
            )
        taken.add(box.name)
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


def add_payload(spec: mujoco.MjSpec, position: Sequence[float], trunk: str) -> None:
    """Fix a box to the trunk at `position` (3,) in its axes [m]; each reset sets its mass."""
    body = spec.body(trunk).add_body(name=PAYLOAD, pos=position)
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=PAYLOAD_HALF_SIZE,
        rgba=FIXED_BOX_RGBA,
        mass=1.0,
        contype=0,
        conaffinity=0,
        group=2,
    )
