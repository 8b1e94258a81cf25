"""Figures of rollouts: paths seen from above, and barriers, inputs, slack and errors over time."""

import io
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, Oval, Shape, Shapes, Wall
from hcbf_gym.drawing import palette, scene_labels, scene_plot
from hcbf_gym.evaluation.recorded import Episode
from hcbf_gym.evaluation.rollouts import UNFILTERED, shown_program
from hcbf_gym.evaluation.sentences import unit_of
from hcbf_gym.scenarios import Scenario

_LINE_STYLES = ("-", "--", ":", "-.")
_ARROW = {"arrowstyle": "->", "color": "k", "lw": 1.2}
_ARROW_SECONDS = 2.0  # of a region's motion, which an arrow shows
_DOT = {"marker": "o", "mec": "k", "mew": 0.6, "ms": 5, "ls": ""}  # where the robot is
_OUTLINE_INTERVAL = 5.0  # [s] between the later outlines of a moving region
_MAX_OUTLINES = 3

LabelledEpisodes = Mapping[tuple[str, str], Episode]  # keys: (policy, program), or any labels


class Picture(Figure):
    """A figure that needs no display, and that notebooks show as a picture."""

    def _repr_png_(self) -> bytes:
        """Return the figure as PNG, which Jupyter shows."""
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of the given size [inch] that needs no display."""
    figure = Picture(figsize=(width, height), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def plot_paths(scenario: Scenario, episodes: LabelledEpisodes) -> Figure:
    """Return the paths in the scene that all episodes share, seen from above.

    Regions that move are filled where they are at the start, and outlined where they are later. A
    dot on each path is where the robot is then. Programs differ in colour, policies in line style.
    """
    figure = new_figure(6.4, 5.4)
    axes = figure.add_subplot()
    scene_plot.draw_scene(axes, scenario)
    positions = np.concatenate([episode.position for episode in episodes.values()])
    low, high = scene_plot.window([*scene_plot.limits(scenario), *positions], ())
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    end = max(float(episode.time[-1]) for episode in episodes.values())
    outline_times = _draw_motion(axes, scenario.barriers, end)
    for ((_, program), episode), style in zip(episodes.items(), _styles(episodes), strict=True):
        # wide and below the others, because an unfiltered robot often follows the reference
        width, zorder = (4.0, 3) if program == UNFILTERED else (1.8, 4)
        axes.plot(*episode.position.T, lw=width, zorder=zorder, **style)
        for t in outline_times:
            position = episode.position[np.abs(episode.time - t).argmin()]
            axes.plot(*position, **_DOT, color=style["color"], zorder=8)
    has_names = scene_labels.name_regions(axes, scenario.barriers, positions)
    all_named = has_names and scenario.map is None  # the regions of a map have no names in it
    handles: list[Artist] = [*scene_labels.rank_patches(scenario.conditions, all_named)]
    if outline_times:
        times = ", ".join(f"{t:g}" for t in outline_times)
        handles.append(Line2D([], [], **_DOT, color="w", label=f"robot at t = {times} s"))
    scene_labels.legend_below(figure, axes, handles)
    axes.set_title(scenario.name, fontsize=10)
    return figure


def _draw_motion(axes: Axes, barriers: Sequence[Barrier], end: float) -> list[float]:
    """Draw arrows and outlines until `end` [s] for moving regions; return the outlines' times."""
    times: set[float] = set()
    shapes = [barrier for barrier in barriers if isinstance(barrier, Shape)]
    moving = [shape for shape in shapes if shape.frame_velocity.any()]
    for shape in moving:
        outline = shape.outline()
        if isinstance(outline, Wall):
            continue
        center = np.array(outline.center if isinstance(outline, Oval) else outline.mean(axis=0))
        tip_x, tip_y = (center + _ARROW_SECONDS * shape.frame_velocity).tolist()
        axes.annotate("", (tip_x, tip_y), (float(center[0]), float(center[1])), arrowprops=_ARROW)
        for t in _OUTLINE_INTERVAL * np.arange(1, _MAX_OUTLINES + 1):
            x, y = (center + t * shape.frame_velocity).tolist()
            if t > end or not axes.viewLim.contains(x, y):
                break
            color = palette.priority_color(shape.priority)
            patch = scene_plot.region_patch(shape, t)
            patch.set(facecolor="none", edgecolor=color, lw=1.0, ls=":", zorder=2)
            axes.add_patch(patch)
            if len(moving) == 1:  # the times of several regions would cover each other
                axes.annotate(f"t = {t:g} s", (x, y), **scene_labels.TEXT_STYLE)
            times.add(float(t))
    return sorted(times)


def plot_series(episodes: LabelledEpisodes) -> Figure:
    """Return each h, the slack of each relaxed rank, and the tracking error, over time.

    All episodes have the conditions of the first one.
    """
    first = next(iter(episodes.values()))
    m = len(first.names)
    ranks = sorted({rank for episode in episodes.values() for rank in _relaxed_ranks(episode)})
    rows = m + len(ranks) + 1
    figure = new_figure(7.2, 1.5 * rows)
    panels = list(np.atleast_1d(figure.subplots(rows, 1, sharex=True)))
    h_panels, slack_panels, error_panel = panels[:m], panels[m:-1], panels[-1]
    for episode, style in zip(episodes.values(), _styles(episodes), strict=True):
        for panel, h in zip(h_panels, episode.h.T, strict=True):
            panel.plot(episode.time, h, lw=1.3, **style)
        for panel, rank in zip(slack_panels, ranks, strict=True):
            slack = episode.slack[:, episode.priority == rank].sum(axis=1)
            panel.plot(episode.time[1:], slack, lw=1.3, **style)
        error_panel.plot(episode.time, episode.tracking_error, lw=1.3, **style)
    for panel, name, rank in zip(h_panels, first.names, first.priority.tolist(), strict=True):
        panel.axhline(0.0, color=palette.priority_color(rank), lw=0.8)
        panel.set_ylabel(f"h of {name}\n(rank {rank}) [{unit_of(name)}]", fontsize=8)
    for panel, rank in zip(slack_panels, ranks, strict=True):
        panel.axhline(0.0, color=palette.priority_color(rank), lw=0.8)
        panel.set_ylabel(f"slack of\nrank {rank} [m/s²]", fontsize=8)
    error_panel.set_ylabel("tracking error\n[m]", fontsize=8)
    error_panel.set_xlabel("t [s]")
    scene_labels.legend_below(figure, panels[0])
    return figure


def _relaxed_ranks(episode: Episode) -> list[int]:
    """Return the ranks of which a row was violated at some step."""
    return np.unique(episode.priority[(episode.slack > 0.0).any(axis=0)]).tolist()


def plot_episode(
    episode: Episode,
    barriers: Sequence[Barrier | Shapes] = (),
    title: str = "",
    labels: Mapping[str, str] | None = None,
    inputs: Sequence[str] | None = None,
) -> Figure:
    """Return one episode: the path from above, h over time by rank, and u* beside u.

    ``figure.savefig("episode.pdf")`` and ``.svg`` save it so that it can be scaled.

    Args:
        episode: an episode of any environment, as `recorded.rollout` returns it.
        barriers: the barriers whose regions are drawn. Shapes are drawn as they are at the first
            instant; others, which may depend on all of the state, at the instant of their least h.
        title: the title above all panels.
        labels: name of a condition → its name in the figure.
        inputs: the names of the n_u inputs in the figure, with their units.
    """
    ranks = sorted(set(episode.priority.tolist()))
    n_u = episode.u.shape[1]
    rows = len(ranks) + n_u
    has_path = bool(np.isfinite(episode.position).all())
    figure = new_figure(10.5 if has_path else 6.5, max(4.0, 1.6 * rows))
    grid = figure.add_gridspec(rows, 2 if has_path else 1)
    if has_path:
        _draw_path(figure.add_subplot(grid[:, 0]), episode, barriers)
    panels = [figure.add_subplot(grid[row, -1]) for row in range(rows)]
    h_panels, input_panels = panels[: len(ranks)], panels[len(ranks) :]
    for panel, rank in zip(h_panels, ranks, strict=True):
        _draw_rank(panel, episode, rank, labels or {})
    for j, panel in enumerate(input_panels):
        _draw_input(panel, episode, j)
        panel.set_ylabel(f"u, entry {j + 1}" if inputs is None else inputs[j], fontsize=8)
    for panel in panels[:-1]:
        panel.tick_params(labelbottom=False)
        panel.sharex(panels[-1])
    panels[-1].set_xlabel("t [s]")
    figure.suptitle(title, fontsize=10)
    return figure


def _draw_rank(panel: Axes, episode: Episode, rank: int, labels: Mapping[str, str]) -> None:
    """Draw the h of each condition of a rank over time; labels are as in `plot_episode`."""
    members = np.flatnonzero(episode.priority == rank).tolist()
    for place, k in enumerate(members):
        name = labels.get(episode.names[k], episode.names[k])
        color = palette.OTHER_COLORS[place % len(palette.OTHER_COLORS)]
        panel.plot(episode.time, episode.h[:, k], color=color, lw=1.2, label=name)
    panel.axhline(0.0, color=palette.priority_color(rank), lw=1.0)
    panel.set_ylabel(f"h, rank {rank}", fontsize=8)
    panel.legend(fontsize=6, ncols=math.ceil(len(members) / 4), loc="upper right")


def _draw_input(panel: Axes, episode: Episode, j: int) -> None:
    """Draw the j-th entry of u* and of u over time, each constant during a step."""
    nominal = {"color": palette.REFERENCE, "ls": "--", "lw": 1.0, "label": "u* (policy)"}
    applied = {"color": palette.PATH, "lw": 1.2, "label": "u (applied)"}
    panel.step(episode.time[:-1], episode.u_nominal[:, j], where="post", **nominal)
    panel.step(episode.time[:-1], episode.u[:, j], where="post", **applied)
    panel.legend(fontsize=6, loc="upper right")


def _draw_path(axes: Axes, episode: Episode, barriers: Sequence[Barrier | Shapes]) -> None:
    """Draw an episode's path among the regions, with its start and its end marked."""
    frame(axes, episode, barriers)
    for barrier in scene_plot.in_drawing_order(barriers):
        k = 0 if isinstance(barrier, Shape) else _sample_of_least_h(episode, barrier)
        scene_plot.draw_barriers(axes, [barrier], float(episode.time[k]), planar_state(episode, k))
    axes.plot(*episode.position.T, color=palette.PATH, lw=1.8, zorder=4)
    axes.plot(*episode.position[0], "o", color="k", ms=4, zorder=5)
    axes.plot(*episode.position[-1], "s", color=palette.PATH, ms=5, zorder=5)


def _sample_of_least_h(episode: Episode, barrier: Barrier | Shapes) -> int:
    """Return the sample at which a barrier's h is least, or 0 if the episode has no such h."""
    if barrier.name not in episode.names:
        return 0
    return int(np.argmin(episode.h[:, episode.names.index(barrier.name)]))


def planar_state(episode: Episode, k: int) -> Array | None:
    """Return the state of sample k; None unless its first two entries are the position."""
    is_planar = np.array_equal(episode.state[:, :2], episode.position)
    return episode.state[k] if is_planar else None


def frame(axes: Axes, episode: Episode, barriers: Sequence[Barrier | Shapes]) -> None:
    """Set the limits and labels of axes that show an episode from above."""
    low, high = scene_plot.window(episode.position, barriers)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set(xlabel="x [m]", ylabel="y [m]")


def _styles(episodes: LabelledEpisodes) -> list[dict[str, Any]]:
    """Return colour, line style and label of each episode's lines, as matplotlib's arguments."""
    policies = list(dict.fromkeys(policy for policy, _ in episodes))
    programs = list(dict.fromkeys(program for _, program in episodes))
    return [
        {
            "color": palette.program_color(program, programs.index(program)),
            "ls": _LINE_STYLES[policies.index(policy) % len(_LINE_STYLES)],
            "label": ("" if len(policies) == 1 else f"{policy}, ") + shown_program(program),
        }
        for policy, program in episodes
    ]
