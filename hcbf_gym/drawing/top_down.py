"""A top-down picture of the reduced-order environment as an RGB array."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hcbf_gym.arrays import Array
from hcbf_gym.drawing import palette
from hcbf_gym.drawing.scene_plot import draw_scene
from hcbf_gym.scenarios import Scenario

_INCHES = 4.8  # the side of the picture as matplotlib sees it, which decides the size of texts


class TopDownView:
    """Draws the scene and the path walked so far, without a display.

    Args:
        side: the width and height of the picture [pixels].
    """

    def __init__(self, side: int = 480) -> None:
        self._figure = Figure((_INCHES, _INCHES), dpi=side / _INCHES, layout="constrained")
        self._canvas = FigureCanvasAgg(self._figure)

    def draw(self, scenario: Scenario, t: float, path: Array) -> NDArray[np.uint8]:
        """Return the picture (side, side, 3).

        Args:
            scenario: the scene.
            t: time [s], for regions that move.
            path: (k, 2) the robot's positions so far, the present one last [m].
        """
        self._figure.clear()
        axes = self._figure.add_subplot()
        draw_scene(axes, scenario, t)
        axes.plot(*path.T, color=palette.PATH, lw=1.8, zorder=4)
        axes.plot(*path[-1], "o", color=palette.PATH, ms=8, zorder=5)
        axes.set_title(f"t = {t:.1f} s", fontsize=9)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()
