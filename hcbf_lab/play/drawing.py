"""What is seen of a session in three dimensions: floor, regions, robot, reference, path, field."""

from typing import Any

import mujoco
import numpy as np
import trimesh
import viser

from hcbf_gym import guidance
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import Oval, Shape, Wall
from hcbf_gym.drawing.palette import PATH, REFERENCE, SPEED_ZONE, paler, priority_color
from hcbf_gym.guidance.field import grid, to_world
from hcbf_gym.scenarios import Scenario
from hcbf_robots.maps import RankedMap

Rgb = tuple[int, int, int]

WALL_LENGTH, WALL_DEPTH = 40.0, 0.6
"""How much of a forbidden half-plane is drawn [m]."""
COLLISION_GROUP = 3
"""The group of geoms that MuJoCo's own viewer hides."""
LOWEST, HIGHEST = 0.004, 0.03
"""Between which heights regions are drawn, each at its own, a higher rank above a lower one [m]."""
WALL_HEIGHT = 0.3
"""Of the strict cells of a map, low enough to look over [m]."""
ARROWS = 25
"""Arrows of the guidance field along the longer side of the scene."""
PATH_POINTS = 400


class Stage:
    """The three-dimensional scene of a page."""

    def __init__(self, server: viser.ViserServer):
        self._scene = server.scene
        self._bodies: list[tuple[int, viser.SceneNodeHandle]] = []
        self._regions: list[tuple[Shape, viser.MeshHandle]] = []
        self._floor: RankedMap | None = None
        self._cells: list[viser.MeshHandle] = []
        self._path: list[Array] = []
        self._line: viser.LineSegmentsHandle | None = None
        self._field: list[viser.ArrowsHandle] = []
        self._scene.configure_default_lights(cast_shadow=False)  # half of a software frame
        self._scene.add_grid(
            "/floor", width=60.0, height=60.0, cell_size=0.5, section_size=5.0, position=(0, 0, 0)
        )
        self._reference = self._scene.add_icosphere("/reference/now", 0.05, rgb(REFERENCE))

    def show_scene(self, scenario: Scenario, t: float) -> None:
        """Draw regions, boxes, reference and goal."""
        for _, handle in self._regions:
            handle.remove()
        self._regions = [
            (region, self._draw_region(k, region, height, t))
            for k, (region, height) in enumerate(stacked(scenario))
        ]
        floor = scenario.map if isinstance(scenario.map, RankedMap) else None
        if floor is not self._floor:
            self._show_map(floor)
        times = np.linspace(0.0, max(scenario.reference.duration, 1e-3), 100)
        line = np.array([[*scenario.reference(s)[0], HIGHEST + 0.005] for s in times])
        self._scene.add_line_segments(
            "/reference/line",
            np.stack([line[:-1:2], line[1::2]], axis=1),
            rgb(REFERENCE),
            thickness=0.02,
        )
        self._scene.add_cylinder(
            "/reference/goal", 0.1, 0.02, rgb(REFERENCE), position=(*scenario.goal, HIGHEST)
        )

    def show_robot(self, model: mujoco.MjModel | None) -> None:
        """Draw another robot: every body of the A1's scene, or a disc for the reduced-order one."""
        for _, handle in self._bodies:
            handle.remove()
        self._bodies = []
        if model is None:
            puck = self._scene.add_cylinder("/robot/body0", 0.12, 0.16, rgb(PATH))
            self._bodies.append((-1, puck))
            return
        for body in range(1, model.nbody):
            frame = self._scene.add_frame(f"/robot/body{body}", show_axes=False)
            self._bodies.append((body, frame))
            for geom in np.flatnonzero(model.geom_bodyid == body).tolist():
                shape = _shape(model, geom)
                if shape is not None and model.geom_group[geom] < COLLISION_GROUP:
                    self._scene.add_mesh_simple(
                        f"/robot/body{body}/geom{geom}",
                        shape.vertices,
                        shape.faces,
                        color=tuple((255 * model.geom_rgba[geom, :3]).astype(int).tolist()),
                        position=model.geom_pos[geom],
                        wxyz=model.geom_quat[geom],
                    )

    def restart(self) -> None:
        """Forget the path."""
        self._path = []

    def move(self, position: Array, poses: Array | None, reference: Array, t: float) -> None:
        """Put the robot, moving regions and the reference's point where they are."""
        for body, handle in self._bodies:
            if poses is None:
                handle.position = (*position.tolist(), 0.1)
            else:
                handle.position, handle.wxyz = poses[body, :3], poses[body, 3:]
        for barrier, handle in self._regions:
            velocity = barrier.frame_velocity
            if velocity.any():
                x, y = (velocity * t).tolist()
                handle.position = (x, y, handle.position[2])
        self._reference.position = (*reference.tolist(), 0.05)
        if not self._path or np.linalg.norm(self._path[-1] - position) > 0.03:
            self._path = [*self._path[-PATH_POINTS:], position]

    def show_path(self) -> None:
        """Draw the path walked."""
        points = np.array([[*p, HIGHEST + 0.01] for p in self._path])
        if len(points) > 1:
            pairs = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
        else:
            pairs = np.zeros((1, 2, 3), dtype=np.float32)
        if self._line is None:
            self._line = self._scene.add_line_segments("/path", pairs, rgb(PATH), thickness=0.03)
        self._line.points = pairs

    def show_field(self, scenario: Scenario | None) -> None:
        """Draw where the guidance field leads from everywhere, or nothing.

        Raises:
            InvalidInputError: if there is no field, as where the goal lies in a strict region.
        """
        for handle in self._field:
            handle.remove()
        self._field = []
        if scenario is None:
            return
        way = guidance.Geodesic()
        way.reset(scenario.conditions, scenario.goal, start=scenario.start)
        geometry = way.geometry[0]
        values = np.array(grid(way.field[0], geometry), dtype=np.float64)
        stride = max(1, max(values.shape) // ARROWS)
        down: Any = np.gradient(-values)
        rows, columns = np.meshgrid(
            *(np.arange(stride // 2, n, stride) for n in values.shape), indexing="ij"
        )
        way_y, way_x = (part[rows, columns].ravel() for part in down)
        length = np.hypot(way_x, way_y)
        goes = np.isfinite(length) & (length > 0.0)
        far = 0.7 * stride / length[goes]
        tails = rows.ravel()[goes], columns.ravel()[goes]
        heads = tails[0] + far * way_y[goes], tails[1] + far * way_x[goes]
        starts, ends = (np.column_stack(to_world(*at, geometry)) for at in (tails, heads))
        reach = 0.7 * stride * geometry[2]
        height = np.full((len(starts), 1), HIGHEST + 0.01)
        arrows = np.stack([np.hstack([starts, height]), np.hstack([ends, height])], axis=1)
        self._field.append(
            self._scene.add_arrows(
                "/field", arrows, (80, 130, 90),
                shaft_radius=0.06 * reach, head_radius=0.16 * reach, head_length=0.4 * reach,
            )
        )  # fmt: skip

    def _show_map(self, floor: RankedMap | None) -> None:
        """Draw each class of a map: flat, and what is strict and known as high as a wall."""
        for handle in self._cells:
            handle.remove()
        self._cells, self._floor = [], floor
        if floor is None:
            return
        ordered = sorted(floor.classes, key=lambda one: (one.limit is None, -one.rank))
        heights = np.linspace(0.25 * LOWEST, LOWEST, len(ordered), endpoint=False).tolist()
        for k, (one, height) in enumerate(zip(ordered, heights, strict=True)):
            wall = WALL_HEIGHT if one.is_strict and one.kind == "keepout" else height
            surface = _raised(floor.polygons(one.name), height, wall)
            if len(surface[1]):
                color = SPEED_ZONE if one.limit is not None else priority_color(one.rank)
                share = 0.7 if one.kind == "unknown" else 0.3
                self._cells.append(
                    self._scene.add_mesh_simple(
                        f"/map/{k}", *surface, color=rgb(paler(color, share)), side="double",
                        flat_shading=True, cast_shadow=False, receive_shadow=False,
                    )
                )  # fmt: skip

    def _draw_region(self, k: int, region: Shape, height: float, t: float) -> viser.MeshHandle:
        corners = _flat(region)
        vertices = np.column_stack([corners, np.zeros(len(corners))])
        fan = np.arange(1, len(corners) - 1)
        faces = np.column_stack([np.zeros(len(fan), dtype=np.int64), fan, fan + 1])
        return self._scene.add_mesh_simple(
            f"/regions/{k}",
            vertices,
            faces,
            color=rgb(paler(priority_color(region.priority))),
            side="double",
            cast_shadow=False,
            receive_shadow=False,
            position=(*(t * region.frame_velocity), height),
        )


def stacked(scenario: Scenario) -> list[tuple[Shape, float]]:
    """Return the regions of a scene, each with another height [m], so that none flickers.

    They are opaque as well: a browser would blend them or not, as it happens to sort them.
    """
    regions = [barrier for barrier in scenario.barriers if isinstance(barrier, Shape)]
    regions.sort(key=lambda region: -region.priority)
    heights = np.linspace(LOWEST, HIGHEST, len(regions))
    return list(zip(regions, heights.tolist(), strict=True))


def _raised(polygons: list[Array], bottom: float, top: float) -> tuple[Array, Integers]:
    """Return vertices (n, 3) and faces (f, 3) of prisms over polygons (k, 2), without floors."""
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    for corners in polygons:
        k = len(corners)
        turn = np.arange(k)
        after = (turn + 1) % k
        vertices.append(
            np.column_stack([np.vstack([corners, corners]), np.repeat([top, bottom], k)])
        )
        fan = np.column_stack([np.zeros(k - 2, dtype=np.int64), turn[1:-1], turn[2:]])
        sides = np.column_stack([turn, k + turn, k + after, turn, k + after, after])
        faces += [count + fan, count + sides.reshape(-1, 3)]
        count += 2 * k
    return np.vstack(vertices), np.vstack(faces)


def rgb(color: str) -> Rgb:
    """Return (r, g, b), 0 … 255, of "#rrggbb"."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def _flat(region: Shape) -> Array:
    """Return (k, 2) the corners of what a region forbids at time 0."""
    drawn = region.outline()
    if isinstance(drawn, Oval):
        return drawn.corners()
    if isinstance(drawn, Wall):
        normal = np.array(drawn.normal)
        along = 0.5 * WALL_LENGTH * np.array([-normal[1], normal[0]])
        foot = drawn.offset * normal
        back = WALL_DEPTH * normal
        return np.array([foot - along, foot + along, foot + along - back, foot - along - back])
    return drawn


def _shape(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh | None:
    """Return the surface of a geom, None for a kind that is not drawn."""
    size = model.geom_size[geom]
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return trimesh.creation.box(extents=2.0 * size)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return trimesh.creation.capsule(height=2.0 * size[1], radius=size[0], count=(8, 12))
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(radius=size[0], height=2.0 * size[1], sections=16)
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        ball = trimesh.creation.icosphere(subdivisions=2)
        radii = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.full(3, size[0])
        ball.apply_scale(radii)
        return ball
    return None
