"""The drawing of a session in three dimensions: regions, map, robot, reference, path and field."""

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

WALL_LENGTH, WALL_DEPTH = 40.0, 0.6  # of the part of a forbidden half-plane that is drawn [m]
COLLISION_GROUP = 3  # the first group of geoms that MuJoCo's viewer hides
LOWEST, HIGHEST = 0.004, 0.03
"""The heights of the regions of the last and of the first rank [m]."""
WALL_HEIGHT = 0.3  # of the strict cells of a map, low enough to see over [m]
ARROWS = 25  # arrows of the guidance field along the longer side of the scene
ARROW_LENGTH = 0.7  # of the distance between two arrows
MAX_PATH_POINTS = 400
PATH_STEP = 0.03  # the least distance between two points of the path [m]


class Stage:
    """The three-dimensional scene of a page, which all browsers share."""

    def __init__(self, server: viser.ViserServer):
        self._scene = server.scene
        self._bodies: list[tuple[int, viser.SceneNodeHandle]] = []  # with MuJoCo's index
        self._regions: list[tuple[Shape, viser.MeshHandle]] = []
        self._map: RankedMap | None = None
        self._map_meshes: list[viser.MeshHandle] = []
        self._path: list[Array] = []
        self._path_line: viser.LineSegmentsHandle | None = None
        self._arrows: list[viser.ArrowsHandle] = []
        self._scene.configure_default_lights(cast_shadow=False)  # shadows double a frame's time
        self._scene.add_grid(
            "/floor", width=60.0, height=60.0, cell_size=0.5, section_size=5.0, position=(0, 0, 0)
        )
        self._reference = self._scene.add_icosphere("/reference/now", 0.05, rgb(REFERENCE))

    def show_scene(self, scenario: Scenario, t: float) -> None:
        """Draw the regions at time t [s], the map, the reference and the goal."""
        for _, handle in self._regions:
            handle.remove()
        self._regions = [
            (region, self._draw_region(k, region, height, t))
            for k, (region, height) in enumerate(stacked(scenario))
        ]
        ranked_map = scenario.map if isinstance(scenario.map, RankedMap) else None
        if ranked_map is not self._map:
            self._show_map(ranked_map)
        times = np.linspace(0.0, max(scenario.reference.duration, 1e-3), 100)
        points = np.array([[*scenario.reference(s)[0], HIGHEST + 0.005] for s in times])
        dashes = np.stack([points[:-1:2], points[1::2]], axis=1)
        self._scene.add_line_segments("/reference/line", dashes, rgb(REFERENCE), thickness=0.02)
        self._scene.add_cylinder(
            "/reference/goal", 0.1, 0.02, rgb(REFERENCE), position=(*scenario.goal, HIGHEST)
        )

    def show_robot(self, model: mujoco.MjModel | None) -> None:
        """Draw another robot: all bodies of its MuJoCo scene, or a disc for None, the model."""
        for _, handle in self._bodies:
            handle.remove()
        self._bodies = []
        if model is None:
            disc = self._scene.add_cylinder("/robot/body0", 0.12, 0.16, rgb(PATH))
            self._bodies.append((-1, disc))
            return
        for body in range(1, model.nbody):
            frame = self._scene.add_frame(f"/robot/body{body}", show_axes=False)
            self._bodies.append((body, frame))
            for geom in np.flatnonzero(model.geom_bodyid == body).tolist():
                surface = _surface(model, geom)
                if surface is not None and model.geom_group[geom] < COLLISION_GROUP:
                    self._scene.add_mesh_simple(
                        f"/robot/body{body}/geom{geom}",
                        surface.vertices,
                        surface.faces,
                        color=tuple((255 * model.geom_rgba[geom, :3]).astype(int).tolist()),
                        position=model.geom_pos[geom],
                        wxyz=model.geom_quat[geom],
                    )

    def restart(self) -> None:
        """Forget the path."""
        self._path = []

    def move(self, position: Array, poses: Array | None, reference: Array, t: float) -> None:
        """Move the robot, the moving regions and the reference to their places at time t [s].

        Position and reference are points (2,) [m]; `poses` is that of a `Snapshot`.
        """
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
        if not self._path or np.linalg.norm(self._path[-1] - position) > PATH_STEP:
            self._path = [*self._path[-MAX_PATH_POINTS:], position]

    def show_path(self) -> None:
        """Draw the last part of the robot's path."""
        points = np.array([[*p, HIGHEST + 0.01] for p in self._path])
        if len(points) > 1:
            lines = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
        else:
            lines = np.zeros((1, 2, 3), dtype=np.float32)
        if self._path_line is None:
            add_lines = self._scene.add_line_segments
            self._path_line = add_lines("/path", lines, rgb(PATH), thickness=0.03)
        self._path_line.points = lines

    def show_field(self, scenario: Scenario | None) -> None:
        """Draw arrows in the direction of the guidance field; None draws none.

        Raises:
            InvalidInputError: if there is no field, for example if the goal is in a strict region.
        """
        for handle in self._arrows:
            handle.remove()
        self._arrows = []
        if scenario is None:
            return
        field = guidance.Geodesic()
        field.reset(scenario.conditions, scenario.goal, start=scenario.start)
        geometry = field.geometry[0]
        distance = np.array(grid(field.field[0], geometry), dtype=np.float64)  # to the goal
        stride = max(1, max(distance.shape) // ARROWS)  # cells from one arrow to the next
        rows, columns = np.meshgrid(
            *(np.arange(stride // 2, n, stride) for n in distance.shape), indexing="ij"
        )
        descent: Any = np.gradient(-distance)
        descent_y, descent_x = (component[rows, columns].ravel() for component in descent)
        slope = np.hypot(descent_x, descent_y)
        is_known = np.isfinite(slope) & (slope > 0.0)
        cells_per_slope = ARROW_LENGTH * stride / slope[is_known]
        tails = rows.ravel()[is_known], columns.ravel()[is_known]
        step_y, step_x = (
            cells_per_slope * descent_y[is_known],
            cells_per_slope * descent_x[is_known],
        )
        heads = tails[0] + step_y, tails[1] + step_x
        height = np.full(len(tails[0]), HIGHEST + 0.01)
        ends = [np.column_stack([*to_world(*cells, geometry), height]) for cells in (tails, heads)]
        arrows = np.stack(ends, axis=1)
        length = ARROW_LENGTH * stride * geometry[2]
        self._arrows.append(
            self._scene.add_arrows(
                "/field", arrows, (80, 130, 90),
                shaft_radius=0.06 * length, head_radius=0.16 * length, head_length=0.4 * length,
            )
        )  # fmt: skip

    def _show_map(self, ranked_map: RankedMap | None) -> None:
        """Draw each class of a map flat on the floor, but known strict cells as walls."""
        for handle in self._map_meshes:
            handle.remove()
        self._map_meshes, self._map = [], ranked_map
        if ranked_map is None:
            return
        ordered = sorted(ranked_map.classes, key=lambda cells: (cells.limit is None, -cells.rank))
        heights = np.linspace(0.25 * LOWEST, LOWEST, len(ordered), endpoint=False).tolist()
        for k, (cells, height) in enumerate(zip(ordered, heights, strict=True)):
            is_wall = cells.is_strict and cells.kind == "keepout"
            vertices, faces = _prisms(
                ranked_map.polygons(cells.name), height, WALL_HEIGHT if is_wall else height
            )
            if not len(faces):
                continue
            color = SPEED_ZONE if cells.limit is not None else priority_color(cells.rank)
            white = 0.7 if cells.kind == "unknown" else 0.3  # share of white in the color
            self._map_meshes.append(
                self._scene.add_mesh_simple(
                    f"/map/{k}", vertices, faces, color=rgb(paler(color, white)), side="double",
                    flat_shading=True, cast_shadow=False, receive_shadow=False,
                )
            )  # fmt: skip

    def _draw_region(self, k: int, region: Shape, height: float, t: float) -> viser.MeshHandle:
        """Draw the k-th region as a fan of triangles at a height [m], where it is at time t [s]."""
        corners = _corners(region)
        vertices = np.column_stack([corners, np.zeros(len(corners))])
        fan = np.arange(1, len(corners) - 1)
        faces = np.column_stack([np.zeros(len(fan), dtype=np.int64), fan, fan + 1])
        return self._scene.add_mesh_simple(
            f"/regions/{k}", vertices, faces, color=rgb(paler(priority_color(region.priority))),
            side="double", cast_shadow=False, receive_shadow=False,
            position=(*(t * region.frame_velocity), height),
        )  # fmt: skip


def stacked(scenario: Scenario) -> list[tuple[Shape, float]]:
    """Return the regions of a scene, each with another height [m], higher for a higher rank.

    At equal heights they would flicker. They are opaque, because blending depends on how a browser
    sorts them.
    """
    regions = [barrier for barrier in scenario.barriers if isinstance(barrier, Shape)]
    regions.sort(key=lambda region: -region.priority)
    heights = np.linspace(LOWEST, HIGHEST, len(regions))
    return list(zip(regions, heights.tolist(), strict=True))


def _prisms(polygons: list[Array], bottom: float, top: float) -> tuple[Array, Integers]:
    """Return vertices (n, 3) and faces (f, 3) of open prisms over convex polygons (k, 2).

    Vertices 0 to k − 1 of a prism are its top, the next k are below them. It has no floor.
    """
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    for corners in polygons:
        k = len(corners)
        corner = np.arange(k)
        following = (corner + 1) % k
        vertices.append(
            np.column_stack([np.vstack([corners, corners]), np.repeat([top, bottom], k)])
        )
        fan = np.column_stack([np.zeros(k - 2, dtype=np.int64), corner[1:-1], corner[2:]])
        sides = np.column_stack(
            [corner, k + corner, k + following, corner, k + following, following]
        )
        faces += [count + fan, count + sides.reshape(-1, 3)]
        count += 2 * k
    return np.vstack(vertices), np.vstack(faces)


def rgb(color: str) -> Rgb:
    """Return (r, g, b), each from 0 to 255, from "#rrggbb"."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def _corners(region: Shape) -> Array:
    """Return the corners (k, 2) of the forbidden area of a region at time 0 [m]."""
    outline = region.outline()
    if isinstance(outline, Oval):
        return outline.corners()
    if isinstance(outline, Wall):
        normal = np.array(outline.normal)
        along = 0.5 * WALL_LENGTH * np.array([-normal[1], normal[0]])
        foot = outline.offset * normal
        back = WALL_DEPTH * normal
        return np.array([foot - along, foot + along, foot + along - back, foot - along - back])
    return outline


def _surface(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh | None:
    """Return the surface of a geom; None if its type is not drawn."""
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
