"""Figures of rollouts: paths seen from above, and barriers, inputs, slack and errors over time."""

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, Oval, Shape, Shapes, Wall
from hcbf_gym.drawing.palette import OTHER_COLORS, PATH, REFERENCE, priority_color, program_color
from hcbf_gym.drawing.scene_plot import (
    NAMED_AT,
    draw_barriers,
    draw_scene,
    legend_below,
    limits,
    name_regions,
    outline,
    rank_patches,
    window,
)
from hcbf_gym.evaluation.recorded import Episode
from hcbf_gym.evaluation.rollouts import UNFILTERED, shown_program
from hcbf_gym.evaluation.sentences import unit_of
from hcbf_gym.scenarios import Scenario

_STYLES = ("-", "--", ":", "-.")
_ARROW = {"arrowstyle": "->", "color": "k", "lw": 1.2}
_LATER = 5.0  # [s] between the later outlines of regions that move
_MOST = 3  # of these

Shown = Mapping[tuple[str, str], Episode]
"""(policy, program) → an episode; either may be any label."""


class Picture(Figure):
    """A figure that needs no display, and that notebooks show as a picture."""

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of the given size [inch] that needs no display."""
    figure = Picture(figsize=(width, height), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def plot_paths(scenario: Scenario, episodes: Shown) -> Figure:
    """Return the paths in the scene that all episodes share, seen from above.

    Regions that move are filled where they are at the start, and outlined where they are later; a
    dot on each path is where the robot is then. Programs differ in colour, policies in style.
    """
    figure = new_figure(6.4, 5.4)
    axes = figure.add_subplot()
    draw_scene(axes, scenario)
    seen = [*limits(scenario), *(place for e in episodes.values() for place in e.position)]
    low, high = window(seen, ())
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    end = max(float(episode.time[-1]) for episode in episodes.values())
    times = _draw_motion(axes, scenario.barriers, end)
    for (key, episode), style in zip(episodes.items(), _styles(episodes), strict=True):
        unfiltered = key[1] == UNFILTERED  # wide and below, as it often follows the reference
        width, above = (4.0, 3) if unfiltered else (1.8, 4)
        axes.plot(*episode.position.T, lw=width, zorder=above, **style)
        for t in times:
            here = episode.position[np.abs(episode.time - t).argmin()]
            axes.plot(*here, "o", color=style["color"], mec="k", mew=0.6, ms=5, zorder=8)
    taken = np.concatenate([e.position for e in episodes.values()])
    named = name_regions(axes, scenario.barriers, taken) and scenario.map is None
    others = rank_patches(scenario.conditions, named)
    if times:
        shown = ", ".join(f"{t:g}" for t in times)
        dot = {"marker": "o", "color": "w", "mec": "k", "mew": 0.6, "ms": 5, "ls": ""}
        others += [Line2D([], [], label=f"robot at t = {shown} s", **dot)]
    legend_below(figure, axes, others)
    axes.set_title(scenario.name, fontsize=10)
    return figure


def _draw_motion(axes: Axes, barriers: Sequence[Barrier], end: float) -> list[float]:
    """Draw where regions move: an arrow for 2 s, and later outlines; return their times [s]."""
    times: set[float] = set()
    shapes = [barrier for barrier in barriers if isinstance(barrier, Shape)]
    moving = [shape for shape in shapes if shape.frame_velocity.any()]
    for barrier in moving:
        drawn = barrier.outline()
        if isinstance(drawn, Wall):
            continue
        center = drawn.center if isinstance(drawn, Oval) else drawn.mean(axis=0)
        tip_x, tip_y = np.add(center, 2.0 * barrier.frame_velocity).tolist()
        axes.annotate("", (tip_x, tip_y), (float(center[0]), float(center[1])), arrowprops=_ARROW)
        color = priority_color(barrier.priority)
        for k in range(1, _MOST + 1):
            t = k * _LATER
            x, y = np.add(center, t * barrier.frame_velocity).tolist()
            later = outline(barrier, t)
            if later is None or t > end or not axes.viewLim.contains(x, y):
                break
            later.set(facecolor="none", edgecolor=color, lw=1.0, ls=":", zorder=2)
            axes.add_patch(later)
            if len(moving) == 1:
                axes.annotate(f"t = {t:g} s", (x, y), **NAMED_AT)
            times.add(t)
    return sorted(times)


def plot_series(episodes: Shown) -> Figure:
    """Return h_k, the slack of each rank that had some, and the tracking error over time."""
    first = next(iter(episodes.values()))
    ranks = sorted({rank for episode in episodes.values() for rank in _relaxed(episode)})
    rows = len(first.names) + len(ranks) + 1
    figure = new_figure(7.2, 1.5 * rows)
    panels = np.atleast_1d(figure.subplots(rows, 1, sharex=True))
    for (_, episode), style in zip(episodes.items(), _styles(episodes), strict=True):
        for k in range(len(first.names)):
            panels[k].plot(episode.time, episode.h[:, k], lw=1.3, **style)
        for panel, rank in zip(panels[len(first.names) :], ranks, strict=False):
            slack = episode.slack[:, episode.priority == rank].sum(axis=1)
            panel.plot(episode.time[1:], slack, lw=1.3, **style)
        panels[-1].plot(episode.time, episode.tracking_error, lw=1.3, **style)
    for panel, name, rank in zip(panels, first.names, first.priority.tolist(), strict=False):
        panel.axhline(0.0, color=priority_color(rank), lw=0.8)
        panel.set_ylabel(f"h of {name}\n(rank {rank}) [{unit_of(name)}]", fontsize=8)
    for panel, rank in zip(panels[len(first.names) :], ranks, strict=False):
        panel.axhline(0.0, color=priority_color(rank), lw=0.8)
        panel.set_ylabel(f"slack of\nrank {rank} [m/s²]", fontsize=8)
    panels[-1].set_ylabel("tracking error\n[m]", fontsize=8)
    panels[-1].set_xlabel("t [s]")
    legend_below(figure, panels[0])
    return figure


def _relaxed(episode: Episode) -> list[int]:
    """Return the ranks of which a row was violated."""
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
        episode: as `recorded.rollout` returns it, of any environment.
        barriers: whose regions are drawn: shapes as they are at the first instant, others, which
            may depend on all of the state, at that at which their h is least.
        title: above all.
        labels: name of a condition → what the figure calls it.
        inputs: what it calls each of the n_u inputs, with the unit.
    """
    ranks = sorted(set(episode.priority.tolist()))
    n_u = episode.u.shape[1]
    rows = len(ranks) + n_u
    seen = bool(np.isfinite(episode.position).all())
    figure = new_figure(10.5 if seen else 6.5, max(4.0, 1.6 * rows))
    grid = figure.add_gridspec(rows, 2 if seen else 1)
    if seen:
        _draw_path(figure.add_subplot(grid[:, 0]), episode, barriers)
    panels = [figure.add_subplot(grid[row, -1]) for row in range(rows)]
    for panel, rank in zip(panels, ranks, strict=False):
        members = np.flatnonzero(episode.priority == rank)
        for place, k in enumerate(members.tolist()):
            name = (labels or {}).get(episode.names[k], episode.names[k])
            color = OTHER_COLORS[place % len(OTHER_COLORS)]
            panel.plot(episode.time, episode.h[:, k], color=color, lw=1.2, label=name)
        panel.axhline(0.0, color=priority_color(rank), lw=1.0)
        panel.set_ylabel(f"h, rank {rank}", fontsize=8)
        panel.legend(fontsize=6, ncols=max(1, -(-len(members) // 4)), loc="upper right")
    for j, panel in enumerate(panels[len(ranks) :]):
        panel.step(episode.time[:-1], episode.u_nominal[:, j], where="post", color=REFERENCE,
                   ls="--", lw=1.0, label="u* (policy)")  # fmt: skip
        panel.step(episode.time[:-1], episode.u[:, j], where="post", color=PATH, lw=1.2,
                   label="u (applied)")  # fmt: skip
        panel.set_ylabel(f"u, entry {j + 1}" if inputs is None else inputs[j], fontsize=8)
        panel.legend(fontsize=6, loc="upper right")
    for panel in panels[:-1]:
        panel.tick_params(labelbottom=False)
        panel.sharex(panels[-1])
    panels[-1].set_xlabel("t [s]")
    figure.suptitle(title, fontsize=10)
    return figure


def _draw_path(axes: Axes, episode: Episode, barriers: Sequence[Barrier | Shapes]) -> None:
    """Draw where an episode went among the regions, start and end marked."""
    frame(axes, episode, barriers)
    for barrier in sorted(barriers, key=lambda b: -b.priority):
        k = 0 if isinstance(barrier, Shape) else _nearest(episode, barrier)
        draw_barriers(axes, [barrier], float(episode.time[k]), seen_from(episode, k))
    axes.plot(*episode.position.T, color=PATH, lw=1.8, zorder=4)
    axes.plot(*episode.position[0], "o", color="k", ms=4, zorder=5)
    axes.plot(*episode.position[-1], "s", color=PATH, ms=5, zorder=5)


def _nearest(episode: Episode, barrier: Barrier | Shapes) -> int:
    """Return the sample at which a barrier's h is least; the first where the episode has none."""
    known = barrier.name in episode.names
    return int(np.argmin(episode.h[:, episode.names.index(barrier.name)])) if known else 0


def seen_from(episode: Episode, k: int) -> Array | None:
    """Return the k-th state; None where its first two entries are not the position."""
    is_position = np.array_equal(episode.state[:, :2], episode.position)
    return episode.state[k] if is_position else None


def frame(axes: Axes, episode: Episode, barriers: Sequence[Barrier | Shapes]) -> None:
    """Set limits and labels of axes that show an episode from above."""
    low, high = window(episode.position, barriers)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set(xlabel="x [m]", ylabel="y [m]")


def _styles(episodes: Shown) -> list[dict[str, Any]]:
    """Return colour, style and label of each episode's lines."""
    policies = list(dict.fromkeys(policy for policy, _ in episodes))
    programs = list(dict.fromkeys(program for _, program in episodes))
    return [
        {
            "color": program_color(program, programs.index(program)),
            "ls": _STYLES[policies.index(policy) % len(_STYLES)],
            "label": ("" if len(policies) == 1 else f"{policy}, ") + shown_program(program),
        }
        for policy, program in episodes
    ]
