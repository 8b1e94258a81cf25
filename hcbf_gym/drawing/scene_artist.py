"""Regions, walls, reference and path as shapes of a MuJoCo scene, without contacts."""

import itertools
import math
from collections import deque
from collections.abc import Sequence

import mujoco
import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Oval, Shape, Wall
from hcbf_gym.drawing import palette
from hcbf_gym.scenarios import Floor, Scenario

Color = tuple[float, float, float, float]

_LAYER = 0.004  # [m] between the heights of two layers on the floor
_TOP_LAYER = 4  # of rank 1; rank 2 is in the next one below, and ranks from 4 on are in layer 1
_WALL_LENGTH, _WALL_HEIGHT, _WALL_THICKNESS = 40.0, 0.25, 0.04  # [m]
_WALL_OPACITY = 0.6
_MAP_RADIUS = 8.0  # [m] around the robot, in which a map is drawn
_GRID_CELL, _GRID_HALF_SIZE = 0.5, 8.0  # [m]
_PATH_SPACING = 0.05  # [m] between two points of the path
_MAX_PATH_POINTS = 1000  # the last ones are retained
_REFERENCE_POINTS = 60
_GOAL_RADIUS = 0.08  # [m]
_LINE_HEIGHT = 0.03  # [m]
_GRID_WIDTH, _REFERENCE_WIDTH, _PATH_WIDTH = 1.0, 3.0, 5.0  # [pixels]
_SHADOW_SEMI_AXES = ((0.30, 0.20), (0.24, 0.14))  # [m] two ovals make the edge soft
_IDENTITY = np.eye(3)


class SceneArtist:
    """Draws a scenario and the robot's path into scenes of MuJoCo's renderers.

    Args:
        lift: the ground's greatest height [m], above which everything is drawn.

    Attributes:
        path_color: (r, g, b, opacity) of the path, each in [0, 1].
    """

    def __init__(self, lift: float = 0.0) -> None:
        self._lift = lift
        self.path_color: Color = palette.rgba(palette.PATH)
        self._path: deque[Sequence[float]] = deque(maxlen=_MAX_PATH_POINTS)
        self._scenario: Scenario | None = None  # of which `_reference` has points
        self._reference: list[Array] = []

    def restart(self) -> None:
        """Forget the path."""
        self._path.clear()

    def walk(self, position: Sequence[float]) -> None:
        """Add a position (2,) [m] to the path, unless the last one is nearby."""
        if not self._path or math.dist(position, self._path[-1]) >= _PATH_SPACING:
            self._path.append(position)

    def draw(
        self, scene: mujoco.MjvScene, scenario: Scenario, t: float, position: Array, yaw: float
    ) -> None:
        """Append the regions, the map, the reference and the path to a MuJoCo scene.

        Args:
            scene: the scene of one of MuJoCo's renderers.
            scenario: the regions and the reference.
            t: time [s], for regions that move.
            position: (2,) of the robot [m].
            yaw: the robot's heading [rad].
        """
        n_before = scene.ngeom
        for barrier in sorted(scenario.barriers, key=lambda b: -b.priority):
            if isinstance(barrier, Shape):
                _draw_shape(scene, barrier, t)
        if scenario.map is not None:
            _draw_map(scene, scenario.map, position)
        _draw_grid(scene, position)
        _draw_shadow(scene, position, yaw)
        self._draw_reference(scene, scenario)
        goal = (*scenario.goal, _GOAL_RADIUS)
        _add(scene, "SPHERE", (_GOAL_RADIUS, 0, 0), goal, palette.rgba(palette.GOAL))
        path = np.array([*self._path, position])
        _draw_lines(scene, path[:-1], path[1:], _PATH_WIDTH, self.path_color)
        for k in range(n_before, scene.ngeom):
            scene.geoms[k].pos[2] += self._lift

    def _draw_reference(self, scene: mujoco.MjvScene, scenario: Scenario) -> None:
        """Draw the reference dashed; its points are computed once for each scenario."""
        if scenario is not self._scenario:
            times = np.linspace(0.0, scenario.reference.duration, _REFERENCE_POINTS)
            self._scenario = scenario
            self._reference = [scenario.reference(t)[0] for t in times]
        starts, ends = self._reference[::2], self._reference[1::2]
        _draw_lines(scene, starts, ends, _REFERENCE_WIDTH, palette.rgba(palette.REFERENCE))


def _height(rank: int) -> float:
    """Return the height at which regions of a rank are drawn, rank 1 on top [m]."""
    return max(1, _TOP_LAYER + 1 - rank) * _LAYER


def _draw_shape(scene: mujoco.MjvScene, shape: Shape, t: float) -> None:
    """Draw the region that a shape forbids at time t [s] on the floor; a wall stands upright."""
    rank_color = palette.priority_color(shape.priority)
    area_color = palette.rgba(palette.paler(rank_color))
    height, shift = _height(shape.priority), shape.frame_velocity * t
    outline = shape.outline()
    if isinstance(outline, Wall):
        normal = np.array(outline.normal)
        center = (outline.offset - _WALL_THICKNESS / 2) * normal
        size = (_WALL_THICKNESS / 2, _WALL_LENGTH / 2, _WALL_HEIGHT / 2)
        rotation, color = _rotation(normal[0], normal[1]), palette.rgba(rank_color, _WALL_OPACITY)
        _add(scene, "BOX", size, (*center, _WALL_HEIGHT / 2), color, rotation)
    elif isinstance(outline, Oval):
        rotation = _rotation(np.cos(outline.angle), np.sin(outline.angle))
        position = (*(np.array(outline.center) + shift), height)
        _add(scene, "CYLINDER", (*outline.semi_axes, 0.0005), position, area_color, rotation)
    else:
        _draw_polygon(scene, outline + shift, height, area_color)


def _draw_map(scene: mujoco.MjvScene, floor: Floor, position: Array) -> None:
    """Draw the pieces of a map around the robot; zones of a speed limit are left out."""
    regions = [region for region in floor.classes if region.limit is None]
    for region in sorted(regions, key=lambda region: -region.rank):
        color = palette.rgba(palette.paler(palette.priority_color(region.rank)))
        for corners in floor.outlines(region, covered=True):
            nearest = np.clip(position, corners.min(axis=0), corners.max(axis=0))
            if math.dist(nearest, position) < _MAP_RADIUS:
                _draw_polygon(scene, corners, _height(region.rank), color)


def _draw_polygon(scene: mujoco.MjvScene, corners: Array, height: float, color: Color) -> None:
    """Draw a convex polygon (k, 2) on the floor as a fan of triangles."""
    first, *others = corners
    for second, third in itertools.pairwise(others):
        edges = np.eye(3)  # MuJoCo's triangle (0, 0), (1, 0), (0, 1) under an affine map
        edges[:2, 0], edges[:2, 1] = second - first, third - first
        _add(scene, "TRIANGLE", (1, 1, 0), (*first, height), color, edges)


def _draw_grid(scene: mujoco.MjvScene, position: Array) -> None:
    """Draw a grid around the robot on the floor, which makes its motion visible."""
    center = np.round(position / _GRID_CELL) * _GRID_CELL
    offsets = np.arange(-_GRID_HALF_SIZE, _GRID_HALF_SIZE + 0.5 * _GRID_CELL, _GRID_CELL)
    color = palette.rgba(palette.FLOOR_LINE, 0.3)
    for across in range(2):
        along = 1 - across
        starts = np.tile(center, (len(offsets), 1))
        starts[:, across] += offsets
        ends = starts.copy()
        starts[:, along] -= _GRID_HALF_SIZE
        ends[:, along] += _GRID_HALF_SIZE
        _draw_lines(scene, starts, ends, _GRID_WIDTH, color)


def _draw_shadow(scene: mujoco.MjvScene, position: Array, yaw: float) -> None:
    """Draw a soft shadow below the robot, above all regions."""
    rotation = _rotation(np.cos(yaw), np.sin(yaw))
    for k, (length, width) in enumerate(_SHADOW_SEMI_AXES):
        center = (*position, (_TOP_LAYER + 1 + 0.5 * k) * _LAYER)
        _add(scene, "CYLINDER", (length, width, 0.0002), center, (0, 0, 0, 0.22), rotation)


def _draw_lines(
    scene: mujoco.MjvScene,
    starts: Sequence[Array] | Array,
    ends: Sequence[Array] | Array,
    width: float,
    color: Color,
) -> None:
    """Draw a line of a width [pixels] from each start (2,) to its end (2,) [m]."""
    for start, end in zip(starts, ends, strict=True):
        if np.array_equal(start, end):  # a line needs a direction
            continue
        geom = _add(scene, "LINE", (1, 1, 1), (0, 0, 0), color)
        if geom is not None:
            start_point, end_point = np.array([[*start, _LINE_HEIGHT], [*end, _LINE_HEIGHT]])
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_LINE, width, start_point, end_point)


def _rotation(cos: float, sin: float) -> Array:
    """Return the rotation matrix (3, 3) about the vertical by an angle of this cosine and sine."""
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _add(
    scene: mujoco.MjvScene,
    kind: str,
    size: tuple[float, ...],
    position: tuple[float, ...],
    color: Color,
    rotation: Array = _IDENTITY,
) -> mujoco.MjvGeom | None:
    """Append a geom of a kind such as "BOX" to a scene and return it; None if the scene is full.

    `size` has its half extents [m], those of a cylinder are its semi-axes and half height;
    `position` (3,) is its centre [m].
    """
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
