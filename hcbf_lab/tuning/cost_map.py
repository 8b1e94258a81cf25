"""Figures of sampled weights: the map of the cost, and the least cost over the samples."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hcbf_gym.evaluation.episode_plot import new_figure
from hcbf_lab.tuning import WINDOW, Samples

_SAMPLER_STYLES = {"normal": ("#000000", "o"), "tpe": ("#0072b2", "s"), "cmaes": ("#d55e00", "^")}
"""The color and the marker of each sampler."""


def inside(samples: Samples) -> Samples:
    """Return the samples of finite cost inside the paper's `WINDOW`, γ₀ ≤ 5 and Δγ ≤ 2.5."""
    is_inside = samples.gamma0 <= WINDOW["gamma0"]
    is_inside &= samples.delta_gamma <= WINDOW["delta_gamma"]
    is_inside &= np.isfinite(samples.cost)
    return Samples(*(values[is_inside] for values in samples))


def draw_cost_map(axes: Axes, samples: Samples) -> None:
    """Draw r_o over (γ₀, Δγ) inside the paper's window, and mark the cheapest sample there."""
    shown = inside(samples)
    colors = axes.tricontourf(shown.gamma0, shown.delta_gamma, shown.offset, 30, cmap="viridis")
    axes.plot(shown.gamma0, shown.delta_gamma, ".", color="k", ms=1.5, alpha=0.35)
    best = shown.gamma0[shown.best], shown.delta_gamma[shown.best]
    star: dict[str, Any] = {"marker": "*", "color": "#e41a1c", "mec": "w", "ms": 15, "zorder": 5}
    label = f"cheapest: ({best[0]:.2f}, {best[1]:.2f})"
    axes.plot(*best, ls="none", label=label, clip_on=False, **star)
    figure = axes.get_figure()
    assert figure is not None
    figure.colorbar(colors, ax=axes, label="$r_o = r - \\min r$ [-]")
    axes.set(xlim=(0.0, WINDOW["gamma0"]), ylim=(0.0, WINDOW["delta_gamma"]))
    axes.set(xlabel="$\\gamma_0$ [-]", ylabel="$\\Delta\\gamma$ [1/m]")
    axes.legend(loc="upper left", fontsize=8)


def plot_cost_map(samples: Samples) -> Figure:
    """Return a figure with the map of r_o."""
    figure = new_figure(6.0, 4.2)
    draw_cost_map(figure.add_subplot(), samples)
    return figure


def plot_samplers(studies: Mapping[str, Samples]) -> Figure:
    """Return a figure of each sampler's least cost after k samples, above the least of all."""
    figure = new_figure(6.0, 4.0)
    axes = figure.add_subplot()
    least_of_all = min(samples.cost.min() for samples in studies.values())
    for name, samples in studies.items():
        color, marker = _SAMPLER_STYLES[name]
        gap = np.minimum.accumulate(samples.cost) - least_of_all
        k = np.arange(1, len(gap) + 1)
        axes.step(k, gap, where="post", color=color, lw=1.5, label=name)
        axes.plot(k[-1:], gap[-1:], marker, color=color, ms=6)
    axes.set_xscale("log")
    axes.set_yscale("symlog", linthresh=1e-2)
    axes.set(xlabel="samples [-]", ylabel="least $r$ so far, above the least of all [-]")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
    return figure
