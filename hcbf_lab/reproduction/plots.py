"""The pictures of figures 5, 6 and 7."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from numpy.typing import NDArray

from hcbf_gym import scenarios
from hcbf_gym.arrays import Array
from hcbf_gym.drawing.palette import PROGRAM_COLORS, priority_color
from hcbf_gym.drawing.scene_labels import legend_below
from hcbf_gym.drawing.scene_plot import draw_scene
from hcbf_gym.evaluation.episode_plot import new_figure
from hcbf_gym.evaluation.rollouts import Episode
from hcbf_lab.reproduction.setting import H3, H4, LIGHT_BOX, Setting, of_role
from hcbf_lab.tuning import Samples, Trajectories
from hcbf_lab.tuning.cost_map import draw_cost_map

R, H = PROGRAM_COLORS["r-cbf-qp"], PROGRAM_COLORS["h-cbf-qp"]
DARKEST_H = "#00253b"
SHADES_OF_H = LinearSegmentedColormap.from_list("h-cbf-qp", ["#a6d8f0", H, DARKEST_H])


def _styles_of_h(episodes: Mapping[Setting, Episode]) -> Iterator[tuple[Episode, dict[str, Any]]]:
    """Yield H's episodes, each with its color and label; a larger γ₀ is darker."""
    hierarchical = of_role(episodes, "hierarchical")
    shades = np.linspace(0.0, 1.0, len(hierarchical))
    for shade, (setting, episode) in zip(shades, hierarchical.items(), strict=True):
        label = f"H, $\\gamma_0 = {setting.gamma0:g}$"
        yield episode, {"color": SHADES_OF_H(shade), "label": label}


def _plot_over_time(
    axes: Axes, episodes: Mapping[Setting, Episode], values_of: Callable[[Episode], Array]
) -> None:
    """Plot a value of R and of H for each γ₀ over time, but not that of too large weights."""
    for episode, style in _styles_of_h(episodes):
        axes.plot(episode.time, values_of(episode), lw=1.3, **style)
    for relaxed in of_role(episodes, "relaxed").values():
        axes.plot(relaxed.time, values_of(relaxed), color=R, lw=1.5, label="R")


def _legend_beside(axes: Axes) -> None:
    """Put the legend to the right of a panel, where it covers nothing."""
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)


def _stacked(cell: SubplotSpec) -> tuple[Axes, Axes]:
    """Return two panels, one above the other, with a common axis of time [s]."""
    upper, lower = np.asarray(cell.subgridspec(2, 1).subplots(sharex=True))
    lower.set_xlabel("$t$ [s]")
    return upper, lower


def fig5_panels(
    episodes: Mapping[Setting, Episode], sampled: Trajectories | None, costs: Samples | None
) -> Figure:
    """Return panels (a) to (d): position, barriers, tracking error and the map of the cost.

    Args:
        episodes: those of R, of H for each γ₀, and of H with too large weights.
        sampled: those of H over the sampled weights, for (a) in the place of H for each γ₀.
        costs: the samples of the cost for (d), or None to leave (d) out.
    """
    figure = new_figure(10.0, 7.6)
    grid = figure.add_gridspec(2, 2)
    x_axes, y_axes = _stacked(grid[0, 0])
    for axes, name, column in ((x_axes, "x", 0), (y_axes, "y", 1)):
        plotted = episodes
        if sampled is not None:
            color, label = SHADES_OF_H(0.1), "H, sampled $(\\gamma_0, \\Delta\\gamma)$"
            axes.plot(sampled.time, sampled.position[:, :, column], color=color, lw=0.5, alpha=0.5)
            axes.plot([], [], color=color, label=label)
            plotted = of_role(episodes, "relaxed")
        _plot_over_time(axes, plotted, lambda episode: episode.position[:, column])  # noqa: B023
        axes.set_ylabel(f"$p_{name}$ [m]")
    x_axes.set_title("(a) position", fontsize=10)
    _legend_beside(x_axes)
    h3_axes, h4_axes = _stacked(grid[0, 1])
    for axes, column, priority in ((h3_axes, H3, 1), (h4_axes, H4, 2)):
        _plot_over_time(axes, episodes, lambda episode: episode.h[:, column])  # noqa: B023
        axes.axhline(0.0, color=priority_color(priority), lw=1.0, ls="--")
        axes.set_ylabel(f"$h_{column + 1}$ [m]")
    h3_axes.set_title("(b) barriers of region 1 and region 2", fontsize=10)
    plotted = of_role(episodes, "relaxed") | of_role(episodes, "hierarchical")
    lowest_h4 = min(episode.h[:, H4].min() for episode in plotted.values())
    h4_axes.set_ylim(min(-2.0, lowest_h4 - 0.1), 1.0)
    axes = figure.add_subplot(grid[1, 0] if costs is not None else grid[1, :])
    _plot_over_time(axes, episodes, lambda episode: episode.tracking_error)
    axes.set(xlabel="$t$ [s]", ylabel="$\\|p_{ref} - p\\|$ [m]")
    axes.set_title("(c) tracking error", fontsize=10)
    _legend_beside(axes)
    if costs is not None:
        axes = figure.add_subplot(grid[1, 1])
        draw_cost_map(axes, costs)
        axes.set_title("(d) cost over the sampled weights", fontsize=10)
    return figure


def fig5e_paths(
    scene: str, rom: Mapping[Setting, Episode], a1: Mapping[Setting, Episode]
) -> Figure:
    """Return panel (e): the paths of figure 5's episodes from above, on both models."""
    figure = new_figure(10.0, 4.0)
    left, right = figure.subplots(1, 2)
    for axes, title, episodes in ((left, "reduced-order model", rom), (right, "A1", a1)):
        draw_scene(axes, scenarios.make(scene))
        for episode, style in _styles_of_h(episodes):
            axes.plot(*episode.position.T, lw=1.4, zorder=4, **style)
        for too_large in of_role(episodes, "too large").values():
            axes.plot(*too_large.position.T, ":", color=DARKEST_H, lw=2.0, zorder=5)
            axes.plot(*too_large.position[-1], "X", color=DARKEST_H, mec="w", ms=9, zorder=6)
            axes.plot([], [], ":X", color=DARKEST_H, label="H, too large: ends here")
        for relaxed in of_role(episodes, "relaxed").values():
            axes.plot(*relaxed.position.T, color=R, lw=1.8, zorder=5, label="R")
        axes.set_title(f"(e) {title}", fontsize=10)
    legend_below(figure, figure.axes[0])
    return figure


def frames(
    names: Sequence[str], films: Sequence[NDArray[np.uint8]], times: Sequence[float]
) -> Figure:
    """Return a figure with a row of pictures for each film, at the times [s] of the columns."""
    figure = new_figure(2.4 * len(times), 1.95 * len(films) + 0.2)
    panels = np.atleast_2d(figure.subplots(len(films), len(times)))
    for row, name, film in zip(panels, names, films, strict=True):
        for axes, time, picture in zip(row, times, film, strict=False):
            axes.imshow(picture)
            axes.set(xticks=[], yticks=[])
            axes.set_title(f"{name}, $t$ = {time:g} s", fontsize=8)
    return figure


def fig6_series(episodes: Mapping[str, Episode]) -> Figure:
    """Return panels (c) and (d): h₃, h₄ and the contacts over time, under R and under H."""
    figure = new_figure(9.0, 3.6)
    panels = figure.subplots(1, 2, sharey=True)
    for letter, axes, (name, episode) in zip("cd", panels, episodes.items(), strict=True):
        for column, label, priority in ((H3, "$h_3$, region 1", 1), (H4, "$h_4$, region 2", 2)):
            h = episode.h[:, column]
            axes.plot(episode.time, h, color=priority_color(priority), lw=1.5, label=label)
        axes.axhline(0.0, color="0.3", lw=0.8, ls="--")
        contact_times = episode.time[1:][episode.obstacle_force[:, LIGHT_BOX] > 0.0]
        if contact_times.size:
            axes.plot(contact_times, np.full(contact_times.size, -1.2), "|", color="k", ms=9)
            axes.plot([], [], "|", color="k", label="contact with region 2's box")
        axes.set(xlabel="$t$ [s]", ylim=(-1.4, 3.0))
        axes.set_title(f"({letter}) {name}", fontsize=10)
    legend_below(figure, panels[-1])
    panels[0].set_ylabel("$h$ [m]")
    return figure


def paths(
    scene: str, runs: Mapping[str, tuple[Episode, str]], title: str, axes: Axes | None = None
) -> Figure:
    """Return a figure of paths from above.

    Args:
        scene: the name of the scene.
        runs: label → (episode, matplotlib's line style); a label of R begins with "R".
        title: the title of the panel.
        axes: the panel to draw on; None makes a figure.
    """
    if axes is None:
        axes = new_figure(5.4, 4.6).add_subplot()
    draw_scene(axes, scenarios.make(scene))
    for label, (episode, style) in runs.items():
        color = R if label.startswith("R") else H
        axes.plot(*episode.position.T, style, color=color, lw=1.8, zorder=4, label=label)
    axes.set_title(title, fontsize=10)
    _legend_beside(axes)
    figure = axes.get_figure()
    assert isinstance(figure, Figure)
    return figure


def fig7(scene: str, relaxed: Episode, hierarchical: Episode) -> Figure:
    """Return figure 7: the paths from above, and the position over time."""
    figure = new_figure(10.0, 4.6)
    grid = figure.add_gridspec(1, 2, width_ratios=(1.1, 1.0))
    runs = {"R": (relaxed, "-"), "H": (hierarchical, "-")}
    paths(scene, runs, "operational space", figure.add_subplot(grid[0]))
    reference = scenarios.make(scene).reference
    p_ref = np.array([reference(t)[0] for t in relaxed.time])
    x_axes, y_axes = _stacked(grid[1])
    for column, (name, axes) in enumerate((("x", x_axes), ("y", y_axes))):
        axes.plot(relaxed.time, p_ref[:, column], "--", color="0.35", lw=1.0, label="reference")
        axes.plot(relaxed.time, relaxed.position[:, column], color=R, lw=1.5, label="R")
        axes.plot(hierarchical.time, hierarchical.position[:, column], color=H, lw=1.5, label="H")
        axes.set_ylabel(f"$p_{name}$ [m]")
    x_axes.set_title("position over time", fontsize=10)
    _legend_beside(x_axes)
    return figure
