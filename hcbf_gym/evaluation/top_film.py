"""A film of an episode seen from above, of any environment whose robot's position is known."""

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.progress import track

from hcbf_gym.barriers import Barrier, Shapes
from hcbf_gym.drawing.palette import PATH
from hcbf_gym.drawing.scene_plot import draw_barriers
from hcbf_gym.errors import InvalidInputError, require
from hcbf_gym.evaluation.episode_plot import frame, planar_state
from hcbf_gym.evaluation.recorded import Episode
from hcbf_gym.programs import FilterStatus

RATE = 25  # pictures in a second of the film
SIDE = 480  # the width and height of a picture [pixels]
_INCHES = 4.8  # the same as matplotlib sees it, which decides the size of texts


def film(episode: Episode, path: str | Path, barriers: Sequence[Barrier | Shapes] = ()) -> None:
    """Write a film of an episode in real time, with the time and the filter's status.

    Args:
        episode: an episode of any environment, as `recorded.rollout` returns it.
        path: the film's file, which ends in .mp4.
        barriers: the barriers whose regions are drawn at each instant.

    Raises:
        MissingDependencyError: if the extra `video` is not installed.
        InvalidInputError: if the robot's position is not known, or the path ends otherwise.
    """
    require("film", "video", "moviepy")
    if Path(path).suffix != ".mp4":
        raise InvalidInputError(f"film: got {str(path)!r}, expected a path that ends in .mp4")
    if not np.isfinite(episode.position).all():
        raise InvalidInputError(
            "film: got an episode that does not say where the robot is, expected one of "
            "rollout(…, positions=), a function x → (x, y) [m]"
        )
    clip: Any = importlib.import_module("moviepy").ImageSequenceClip
    clip(_pictures(episode, barriers), fps=RATE).write_videofile(str(path), logger=None)


def _pictures(episode: Episode, barriers: Sequence[Barrier | Shapes]) -> list[NDArray[np.uint8]]:
    """Return the film's pictures, each (`SIDE`, `SIDE`, 3)."""
    figure = Figure((_INCHES, _INCHES), dpi=SIDE / _INCHES, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    frame(axes, episode, barriers)
    (path_line,) = axes.plot([], [], color=PATH, lw=1.8, zorder=4)
    (robot_dot,) = axes.plot([], [], "o", color=PATH, ms=8, zorder=5)
    times = np.arange(episode.time[0], episode.time[-1], 1.0 / RATE)
    newest_samples = np.searchsorted(episode.time, times, side="right") - 1
    pictures = []
    for k in track(newest_samples.tolist(), "filming"):
        time, state = float(episode.time[k]), planar_state(episode, k)
        region_artists = draw_barriers(axes, barriers, time, state)
        path_line.set_data(*episode.position[: k + 1].T)
        robot_dot.set_data(*episode.position[k : k + 1].T)
        status = FilterStatus(int(episode.status[min(k, len(episode.status) - 1)])).name
        axes.set_title(f"t = {time:.1f} s, {status}", fontsize=9)
        canvas.draw()
        pictures.append(np.asarray(canvas.buffer_rgba())[..., :3].copy())
        for artist in region_artists:
            artist.remove()
    return pictures
