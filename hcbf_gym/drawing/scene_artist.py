"""Regions, walls, reference and path as shapes of a MuJoCo scene, without contacts."""

import itertools
import math
from collections import deque
from collections.abc import Sequence

import mujoco
import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, Oval, Shape, Wall
from hcbf_gym.drawing import palette
from hcbf_gym.scenarios import Floor, Scenario

Color = tuple[float, float, float, float]

_LAYER = 0.004  # [m] between a rank and the next, the first on top
_WALL_LENGTH, _WALL_HEIGHT, _WALL_OPACITY = 40.0, 0.25, 0.6  # [m], [m]
_MAP_SEEN = 8.0  # [m] how far around the robot a map is drawn
_GRID_CELL, _GRID_HALF_SIZE = 0.5, 8.0  # [m]
_STRIDE = 0.05  # [m] between two points of the path
_PATH_POINTS = 1000  # of which the last ones are retained
_REFERENCE_POINTS = 60
_LINE_HEIGHT = 0.03  # [m]
_GRID_WIDTH, _LINE_WIDTH, _PATH_WIDTH = 1.0, 3.0, 5.0  # [pixels]
_SHADOW = ((0.30, 0.20), (0.24, 0.14))  # [m] semi-axes of the blots that make a soft shadow
_IDENTITY = np.eye(3)


class SceneArtist:
    """Draws a scenario and the robot's path.

    Args:
        lift: the ground's greatest height [m]; all is painted above that.

    Attributes:
        path_color: (r, g, b, opacity) of the path, each in [0, 1].
    """

    def __init__(self, lift: float = 0.0) -> None:
        self._lift = lift
        self.path_color: Color = palette.rgba(palette.PATH)
        self._path: deque[Sequence[float]] = deque(maxlen=_PATH_POINTS)
        self._scenario: Scenario | None = None
        self._reference: list[Array] = []

    def restart(self) -> None:
        """Forget the path."""
        self._path.clear()

    def walk(self, position: Sequence[float]) -> None:
        """Add a position (2,) [m] to the path, unless it is next to the last one."""
        if not self._path or math.dist(position, self._path[-1]) >= _STRIDE:
            self._path.append(position)

    def draw(
        self, scene: mujoco.MjvScene, scenario: Scenario, t: float, position: Array, yaw: float
    ) -> None:
        """Append all that is drawn at time t [s] to a MuJoCo scene.

        Args:
            scene: of MuJoCo's renderer.
            scenario: its regions and reference.
            t: time [s], for regions that move.
            position: (2,) of the robot [m].
            yaw: its heading [rad].
        """
        first = scene.ngeom
        for barrier in sorted(scenario.barriers, key=lambda b: -b.priority):
            _draw_barrier(scene, barrier, t)
        if scenario.map is not None:
            _draw_map(scene, scenario.map, position)
        _draw_grid(scene, position)
        _draw_shadow(scene, position, yaw)
        if scenario is not self._scenario:
            times = np.linspace(0.0, scenario.reference.duration, _REFERENCE_POINTS)
            self._scenario = scenario
            self._reference = [scenario.reference(s)[0] for s in times]
        dashes = self._reference[::2], self._reference[1::2]
        _draw_line(scene, *dashes, _LINE_WIDTH, palette.rgba(palette.REFERENCE))
        _add(scene, "SPHERE", (0.08, 0, 0), (*scenario.goal, 0.08), palette.rgba(palette.GOAL))
        walked = np.array([*self._path, position])
        _draw_line(scene, walked[:-1], walked[1:], _PATH_WIDTH, self.path_color)
        for k in range(first, scene.ngeom):
            scene.geoms[k].pos[2] += self._lift


def _draw_barrier(scene: mujoco.MjvScene, barrier: Barrier, t: float) -> None:
    if not isinstance(barrier, Shape):
        return
    name = palette.priority_color(barrier.priority)
    color = palette.rgba(palette.paler(name))
    height = max(1.0, 5.0 - barrier.priority) * _LAYER
    shift, drawn = barrier.frame_velocity * t, barrier.outline()
    if isinstance(drawn, Wall):
        normal = np.array(drawn.normal)
        center = (drawn.offset - 0.02) * normal
        size = (0.02, _WALL_LENGTH / 2, _WALL_HEIGHT / 2)
        rotation, wall = _turn(normal[0], normal[1]), palette.rgba(name, _WALL_OPACITY)
        _add(scene, "BOX", size, (*center, _WALL_HEIGHT / 2), wall, rotation)
    elif isinstance(drawn, Oval):
        rotation = _turn(np.cos(drawn.angle), np.sin(drawn.angle))
        position = (*(np.array(drawn.center) + shift), height)
        _add(scene, "CYLINDER", (*drawn.semi_axes, 0.0005), position, color, rotation)
    else:
        _draw_polygon(scene, drawn + shift, height, color)


def _draw_map(scene: mujoco.MjvScene, ranked: Floor, position: Array) -> None:
    """Draw the pieces of a map around the robot, the highest ranks on top."""
    for one in sorted(ranked.classes, key=lambda c: -c.rank):
        color = palette.rgba(palette.paler(palette.priority_color(one.rank)))
        height = max(1.0, 5.0 - one.rank) * _LAYER
        for corners in ranked.outlines(one, covered=True) if one.limit is None else ():
            nearest = np.clip(position, corners.min(axis=0), corners.max(axis=0))
            if math.dist(nearest, position) < _MAP_SEEN:
                _draw_polygon(scene, corners, height, color)


def _draw_polygon(scene: mujoco.MjvScene, corners: Array, height: float, color: Color) -> None:
    """Draw a convex polygon (k, 2) on the floor as a fan of triangles."""
    first, *others = corners
    for second, third in itertools.pairwise(others):
        edges = np.eye(3)  # MuJoCo's triangle (0, 0), (1, 0), (0, 1) under an affine map
        edges[:2, 0], edges[:2, 1] = second - first, third - first
        _add(scene, "TRIANGLE", (1, 1, 0), (*first, height), color, edges)


def _draw_grid(scene: mujoco.MjvScene, position: Array) -> None:
    """Draw a grid on the floor and the regions, which makes the robot's motion visible."""
    middle = np.round(position / _GRID_CELL) * _GRID_CELL
    steps = np.arange(-_GRID_HALF_SIZE, _GRID_HALF_SIZE + 0.5 * _GRID_CELL, _GRID_CELL)
    for axis in range(2):
        starts = np.tile(middle, (len(steps), 1))
        starts[:, axis] += steps
        ends = starts.copy()
        starts[:, 1 - axis] -= _GRID_HALF_SIZE
        ends[:, 1 - axis] += _GRID_HALF_SIZE
        color = palette.rgba(palette.FLOOR_LINE, 0.3)
        _draw_line(scene, list(starts), list(ends), _GRID_WIDTH, color)


def _draw_shadow(scene: mujoco.MjvScene, position: Array, yaw: float) -> None:
    rotation = _turn(np.cos(yaw), np.sin(yaw))
    for k, (length, width) in enumerate(_SHADOW):
        place = (*position, (5.0 + 0.5 * k) * _LAYER)
        _add(scene, "CYLINDER", (length, width, 0.0002), place, (0, 0, 0, 0.22), rotation)


def _draw_line(
    scene: mujoco.MjvScene,
    starts: Sequence[Array] | Array,
    ends: Sequence[Array] | Array,
    width: float,
    color: Color,
) -> None:
    for start, end in zip(starts, ends, strict=False):
        if np.array_equal(start, end):
            continue
        geom = _add(scene, "LINE", (1, 1, 1), (0, 0, 0), color)
        if geom is not None:
            a, b = np.array([*start, _LINE_HEIGHT]), np.array([*end, _LINE_HEIGHT])
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_LINE, width, a, b)


def _turn(cos: float, sin: float) -> Array:
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _add(
    scene: mujoco.MjvScene,
    kind: str,
    size: tuple[float, ...],
    position: tuple[float, ...],
    color: Color,
    rotation: Array = _IDENTITY,
) -> mujoco.MjvGeom | None:
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom,
        getattr(mujoco.mjtGeom, f"mjGEOM_{kind}"),
        np.array(size, dtype=np.float64),
        np.array(position, dtype=np.float64),
        rotation.ravel(),
        np.array(color, dtype=np.float32),
    )
    if kind == "CYLINDER":  # mjv_initGeom reads (radius, half length); here the base may be oval
        geom.size[:] = size
    scene.ngeom += 1
    return geom
