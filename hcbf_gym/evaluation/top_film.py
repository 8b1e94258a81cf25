"""A film of an episode seen from above, of any environment whose robot has a place."""

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.progress import track

from hcbf_gym.barriers import Barrier, Shapes
from hcbf_gym.drawing.palette import PATH
from hcbf_gym.drawing.scene_plot import draw_barriers
from hcbf_gym.errors import InvalidInputError, require
from hcbf_gym.evaluation.episode_plot import frame, seen_from
from hcbf_gym.evaluation.recorded import Episode
from hcbf_gym.programs import FilterStatus

RATE = 25
"""Pictures in a second of the film."""
SIDE = 480
"""Of a picture [pixels]."""


def film(episode: Episode, path: str | Path, barriers: Sequence[Barrier | Shapes] = ()) -> None:
    """Write a film of an episode as it happened, with the time and the filter's status.

    Args:
        episode: as `recorded.rollout` returns it.
        path: of the film, which ends in .mp4.
        barriers: whose regions are drawn as they are at each instant.

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


def _pictures(episode: Episode, barriers: Sequence[Barrier | Shapes]) -> list[np.ndarray]:
    figure = Figure(figsize=(4.8, 4.8), dpi=SIDE / 4.8, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    frame(axes, episode, barriers)
    (way,) = axes.plot([], [], color=PATH, lw=1.8, zorder=4)
    (robot,) = axes.plot([], [], "o", color=PATH, ms=8, zorder=5)
    times = np.arange(episode.time[0], episode.time[-1], 1.0 / RATE)
    shown = np.searchsorted(episode.time, times, side="right") - 1
    pictures = []
    for k in track(shown.tolist(), "filming"):
        drawn = draw_barriers(axes, barriers, float(episode.time[k]), seen_from(episode, k))
        way.set_data(*episode.position[: k + 1].T)
        robot.set_data(*episode.position[k : k + 1].T)
        status = FilterStatus(int(episode.status[min(k, len(episode.status) - 1)])).name
        axes.set_title(f"t = {episode.time[k]:.1f} s, {status}", fontsize=9)
        canvas.draw()
        pictures.append(np.asarray(canvas.buffer_rgba())[..., :3].copy())
        for artist in drawn:
            artist.remove()
    return pictures
