"""The pictures of figures 5, 6 and 7."""

from collections.abc import Mapping, Sequence
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
from hcbf_lab.tuning import Samples, Trajectories
from hcbf_lab.tuning.cost_map import draw_cost_map

R, H = PROGRAM_COLORS["r-cbf-qp"], PROGRAM_COLORS["h-cbf-qp"]
_DARKEST_H = "#00253b"
_SHADES = LinearSegmentedColormap.from_list("h-cbf-qp", ["#a6d8f0", H, _DARKEST_H])
_H3, _H4 = 2, 3  # columns of h: region 1 and region 2


def _style_of_h(k: int, gammas: Sequence[float]) -> dict[str, Any]:
    """Return color and label of H with the k-th γ₀; larger ones are darker."""
    color = _SHADES(k / max(len(gammas) - 1, 1))
    return {"color": color, "label": f"H, $\\gamma_0 = {gammas[k]:g}$"}


def _plot_r_and_h(axes: Axes, time: Array, values: Array, gammas: Sequence[float]) -> None:
    """Plot over time the value of R (column 0), and of H for each γ₀ (the columns after it)."""
    for k in range(len(gammas)):
        axes.plot(time, values[:, k + 1], lw=1.3, **_style_of_h(k, gammas))
    axes.plot(time, values[:, 0], color=R, lw=1.5, label="R")


def _legend_beside(axes: Axes) -> None:
    """Put the legend to the right of a panel, where it covers nothing."""
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)


def _stacked(cell: SubplotSpec) -> tuple[Axes, Axes]:
    """Return two panels, one above the other, with a common axis of time [s]."""
    upper, lower = np.asarray(cell.subgridspec(2, 1).subplots(sharex=True))
    lower.set_xlabel("$t$ [s]")
    return upper, lower


def fig5_panels(
    run: Trajectories, gammas: Sequence[float], fan: Trajectories | None, samples: Samples | None
) -> Figure:
    """Return panels (a) to (d): position, barriers, tracking error and the map of the cost.

    Args:
        run: trajectories of R, of H for each γ₀, and of H with too large weights.
        gammas: (n,) those γ₀.
        fan: trajectories of H over the sampled weights for (a), or None to plot those of `run`.
        samples: the samples of the cost for (d), or None to leave (d) out.
    """
    figure = new_figure(10.0, 7.6)
    grid = figure.add_gridspec(2, 2)
    for axis, (name, axes) in enumerate(zip("xy", _stacked(grid[0, 0]), strict=True)):
        if fan is None:
            _plot_r_and_h(axes, run.time, run.position[:, :, axis], gammas)
        else:
            axes.plot(fan.time, fan.position[:, :, axis], color=_SHADES(0.1), lw=0.5, alpha=0.5)
            axes.plot([], [], color=_SHADES(0.1), label="H, sampled $(\\gamma_0, \\Delta\\gamma)$")
            axes.plot(run.time, run.position[:, 0, axis], color=R, lw=1.5, label="R")
        axes.set_ylabel(f"$p_{name}$ [m]")
        if name == "x":
            axes.set_title("(a) position", fontsize=10)
            _legend_beside(axes)
    h3_axes, h4_axes = _stacked(grid[0, 1])
    for axes, k, priority in ((h3_axes, _H3, 1), (h4_axes, _H4, 2)):
        _plot_r_and_h(axes, run.time, run.h[:, :, k], gammas)
        axes.axhline(0.0, color=priority_color(priority), lw=1.0, ls="--")
        axes.set_ylabel(f"$h_{k + 1}$ [m]")
    h3_axes.set_title("(b) barriers of region 1 and region 2", fontsize=10)
    h4_axes.set_ylim(min(-2.0, run.h[:, :-1, _H4].min() - 0.1), 1.0)
    axes = figure.add_subplot(grid[1, 0] if samples is not None else grid[1, :])
    _plot_r_and_h(axes, run.time, run.tracking_error, gammas)
    axes.set(xlabel="$t$ [s]", ylabel="$\\|p_{ref} - p\\|$ [m]")
    axes.set_title("(c) tracking error", fontsize=10)
    _legend_beside(axes)
    if samples is not None:
        axes = figure.add_subplot(grid[1, 1])
        draw_cost_map(axes, samples)
        axes.set_title("(d) cost over the sampled weights", fontsize=10)
    return figure


def fig5e_paths(scene: str, rom: Trajectories, a1: Trajectories, gammas: Sequence[float]) -> Figure:
    """Return panel (e): the paths of figure 5's trajectories from above, on both models."""
    figure = new_figure(10.0, 4.0)
    left, right = figure.subplots(1, 2)
    for axes, title, run in ((left, "reduced-order model", rom), (right, "A1", a1)):
        draw_scene(axes, scenarios.make(scene))
        for k in range(len(gammas)):
            axes.plot(*run.position[:, k + 1].T, lw=1.4, zorder=4, **_style_of_h(k, gammas))
        too_large = run.position[:, -1]
        axes.plot(*too_large.T, ":", color=_DARKEST_H, lw=2.0, zorder=5)
        axes.plot(*too_large[-1], "X", color=_DARKEST_H, mec="w", ms=9, zorder=6)
        axes.plot([], [], ":X", color=_DARKEST_H, label="H, too large: ends here")
        axes.plot(*run.position[:, 0].T, color=R, lw=1.8, zorder=5, label="R")
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
        for region, k in ((1, _H3), (2, _H4)):
            label = f"$h_{k + 1}$, region {region}"
            h = episode.h[:, k]
            axes.plot(episode.time, h, color=priority_color(region), lw=1.5, label=label)
        axes.axhline(0.0, color="0.3", lw=0.8, ls="--")
        touching = episode.time[1:][episode.obstacle_force[:, 0] > 0.0]
        if touching.size:
            axes.plot(touching, np.full(touching.size, -1.2), "|", color="k", ms=9)
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
        title: of the panel.
        axes: to draw on; None makes a figure.
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
    for axis, (name, axes) in enumerate(zip("xy", _stacked(grid[1]), strict=True)):
        axes.plot(relaxed.time, p_ref[:, axis], "--", color="0.35", lw=1.0, label="reference")
        axes.plot(relaxed.time, relaxed.position[:, axis], color=R, lw=1.5, label="R")
        axes.plot(hierarchical.time, hierarchical.position[:, axis], color=H, lw=1.5, label="H")
        axes.set_ylabel(f"$p_{name}$ [m]")
        if name == "x":
            axes.set_title("position over time", fontsize=10)
            _legend_beside(axes)
    return figure
