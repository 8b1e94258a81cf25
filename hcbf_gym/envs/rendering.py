"""Pictures of the full-physics scene: regions, walls, reference and path drawn around the robot."""

import os
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hcbf_gym.barriers import Barrier, ConvexPolygon, Disc, Ellipse, HalfPlane, PlanarBarrier
from hcbf_gym.envs.scene_plot import priority_color
from hcbf_gym.errors import RenderingError
from hcbf_gym.scenarios import Scenario

Array = NDArray[np.float64]

HEIGHT, WIDTH = 480, 640

_PATH_POINTS = 300
_REFERENCE_POINTS = 60
_WALL_LENGTH, _WALL_HEIGHT = 40.0, 0.25
_IDENTITY = np.eye(3).ravel()


class SceneArtist:
    """Draws what the robot cannot feel: regions, walls, the reference, and the path walked.

    Attributes:
        path_color: (r, g, b, opacity) of the path, each in [0, 1].
    """

    def __init__(self) -> None:
        self.path_color = (0.0, 0.45, 0.7, 1.0)
        self._path: list[Array] = []

    def restart(self) -> None:
        """Forget the path."""
        self._path = []

    def walk(self, position: Array) -> None:
        """Add a position (2,) [m] to the path."""
        self._path.append(position)

    def draw(self, scene: mujoco.MjvScene, scenario: Scenario, t: float) -> None:
        """Append the scenario at time t and the path to a MuJoCo scene."""
        for barrier in scenario.barriers:
            _draw_barrier(scene, barrier, t)
        times = np.linspace(0.0, scenario.reference.duration, _REFERENCE_POINTS)
        reference = [scenario.reference(s)[0] for s in times]
        _draw_line(scene, reference[::2], reference[1::2], 0.015, (0.25, 0.25, 0.25, 1.0))
        _add(scene, "SPHERE", (0.08, 0, 0), (*scenario.goal, 0.08), (0.1, 0.1, 0.1, 1.0))
        path = self._path[:: max(1, len(self._path) // _PATH_POINTS)]
        _draw_line(scene, path[:-1], path[1:], 0.02, self.path_color)


class OffscreenRenderer:
    """Renders RGB frames without a display.

    Args:
        model: the compiled scene.

    Raises:
        RenderingError: if no OpenGL context can be made; the message says what to install.
    """

    def __init__(self, model: mujoco.MjModel):
        model.vis.quality.numslices = 96  # or large regions show corners
        try:
            self._renderer = mujoco.Renderer(model, HEIGHT, WIDTH, max_geom=2000)
        except Exception as error:  # MuJoCo raises whatever the GL library does
            raise RenderingError(
                f"render_mode 'rgb_array': got no OpenGL context ({error}), expected EGL "
                "(Debian: apt-get install libegl1 libgl1-mesa-dri) and MUJOCO_GL=egl or unset "
                "before MuJoCo is imported"
            ) from error

    def frame(
        self, data: mujoco.MjData, artist: SceneArtist, scenario: Scenario, t: float
    ) -> NDArray[np.uint8]:
        """Return a picture (480, 640, 3) that follows the robot."""
        self._renderer.update_scene(data, camera=chase_camera(data))
        artist.draw(self._renderer.scene, scenario, t)
        return self._renderer.render()

    def close(self) -> None:
        """Release the OpenGL context."""
        self._renderer.close()


class WindowRenderer:
    """Shows the scene in MuJoCo's own viewer, which needs a display.

    Raises:
        RenderingError: if no window can be opened.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData):
        if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise RenderingError(
                "render_mode 'human': got no DISPLAY, expected a desktop session; "
                "without one use render_mode='rgb_array'"
            )
        import mujoco.viewer

        self._viewer: Any = mujoco.viewer.launch_passive(model, data)

    def show(self, artist: SceneArtist, scenario: Scenario, t: float) -> None:
        """Draw the present state."""
        with self._viewer.lock():
            self._viewer.user_scn.ngeom = 0
            artist.draw(self._viewer.user_scn, scenario, t)
        self._viewer.sync()

    def close(self) -> None:
        """Close the window."""
        self._viewer.close()


def chase_camera(data: mujoco.MjData) -> mujoco.MjvCamera:
    """Return a camera that follows the robot, looking down from the south."""
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.lookat[:] = data.subtree_com[1]
    camera.distance, camera.azimuth, camera.elevation = 3.2, 110.0, -32.0
    return camera


def _draw_barrier(scene: mujoco.MjvScene, barrier: Barrier, t: float) -> None:
    if not isinstance(barrier, PlanarBarrier):
        return
    color = (*_rgb(priority_color(barrier.priority)), 0.35)
    height = 0.006 / barrier.priority  # the higher priority lies on top
    shift = barrier.frame_velocity * t
    if isinstance(barrier, HalfPlane):
        normal = np.array(barrier.normal)
        center = (barrier.offset - 0.02) * normal
        size = (0.02, _WALL_LENGTH / 2, _WALL_HEIGHT / 2)
        rotation = np.array([[normal[0], -normal[1], 0], [normal[1], normal[0], 0], [0, 0, 1]])
        _add(scene, "BOX", size, (*center, _WALL_HEIGHT / 2), color, rotation.ravel())
    elif isinstance(barrier, Disc):
        size = (barrier.radius, barrier.radius, height)
        _add(scene, "CYLINDER", size, (*(np.array(barrier.center) + shift), height), color)
    elif isinstance(barrier, Ellipse):
        cos, sin = np.cos(barrier.angle), np.sin(barrier.angle)
        rotation = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        position = (*(np.array(barrier.center) + shift), height)
        _add(scene, "CYLINDER", (*barrier.semi_axes, height), position, color, rotation.ravel())
    elif isinstance(barrier, ConvexPolygon):
        corners = list(np.array(barrier.vertices) + shift)
        _draw_line(scene, corners, corners[1:] + corners[:1], 0.03, (*color[:3], 0.8))


def _draw_line(
    scene: mujoco.MjvScene,
    starts: list[Array],
    ends: list[Array],
    radius: float,
    color: tuple[float, ...],
) -> None:
    for start, end in zip(starts, ends, strict=False):
        geom = _add(scene, "CAPSULE", (radius, 0, 0), (0, 0, 0), color)
        if geom is not None:
            a, b = np.array([*start, 0.02]), np.array([*end, 0.02])
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, radius, a, b)


def _add(
    scene: mujoco.MjvScene,
    kind: str,
    size: tuple[float, ...],
    position: tuple[float, ...],
    color: tuple[float, ...],
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
        rotation,
        np.array(color, dtype=np.float32),
    )
    if kind == "CYLINDER":  # mjv_initGeom reads (radius, half length); here the base may be oval
        geom.size[:] = size
    scene.ngeom += 1
    return geom


def _rgb(color: str) -> tuple[float, float, float]:
    return tuple(int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))  # type: ignore[return-value]
