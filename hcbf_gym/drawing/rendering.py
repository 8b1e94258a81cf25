"""Pictures of the full-physics scene: offscreen, or in a window."""

import os
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hcbf_gym.arrays import Array
from hcbf_gym.drawing.scene_artist import SceneArtist
from hcbf_gym.errors import RenderingError
from hcbf_gym.scenarios import Scenario

HEIGHT, WIDTH = 480, 640

_SLICES, _STACKS = 56, 6  # of round shapes: more cost time, with fewer their corners are visible
_MAX_GEOMS = 2000  # bodies, regions and the path together
_DISTANCE = 3.2  # [m] of the camera from the robot
_AZIMUTH, _ELEVATION = 110.0, -32.0  # [deg] directions in which the camera looks
_TRUNK = 1  # the index of the trunk's body: 0 is the world


class OffscreenRenderer:
    """Renders RGB frames without a display.

    Raises:
        RenderingError: if no OpenGL context can be made.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData):
        self._data = data
        model.vis.quality.numslices, model.vis.quality.numstacks = _SLICES, _STACKS
        try:
            self._renderer = mujoco.Renderer(model, HEIGHT, WIDTH, max_geom=_MAX_GEOMS)
        except Exception as error:  # MuJoCo raises whatever the GL library does
            raise RenderingError(
                f"render_mode 'rgb_array': there is no OpenGL context ({error}), expected EGL "
                "(Debian: apt-get install libegl1 libgl1-mesa-dri) and MUJOCO_GL=egl or unset "
                "before MuJoCo is imported"
            ) from error

    def draw(self, artist: SceneArtist, scenario: Scenario, t: float) -> NDArray[np.uint8]:
        """Return a picture (480, 640, 3) of a scene at time t [s], from south of the robot."""
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        camera.lookat[:] = self._data.subtree_com[_TRUNK]
        camera.distance, camera.azimuth, camera.elevation = _DISTANCE, _AZIMUTH, _ELEVATION
        self._renderer.update_scene(self._data, camera=camera)
        artist.draw(self._renderer.scene, scenario, t, *_trunk_pose(self._data))
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
                "render_mode 'human': DISPLAY is not set, expected a desktop session; "
                "without one use render_mode='rgb_array'"
            )
        import mujoco.viewer

        self._data = data
        self._viewer: Any = mujoco.viewer.launch_passive(model, data)

    def draw(self, artist: SceneArtist, scenario: Scenario, t: float) -> None:
        """Show the robot's present state in a scene at time t [s]."""
        with self._viewer.lock():
            self._viewer.user_scn.ngeom = 0
            artist.draw(self._viewer.user_scn, scenario, t, *_trunk_pose(self._data))
        self._viewer.sync()

    def close(self) -> None:
        """Close the window."""
        self._viewer.close()


def _trunk_pose(data: mujoco.MjData) -> tuple[Array, float]:
    """Return position (2,) [m] and heading [rad] of the robot's trunk."""
    forward = data.xmat[_TRUNK].reshape(3, 3)[:, 0]
    return data.xpos[_TRUNK, :2].copy(), float(np.arctan2(forward[1], forward[0]))
