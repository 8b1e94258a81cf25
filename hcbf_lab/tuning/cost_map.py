"""Figures of sampled weights: the map of the cost and how fast a sampler gets there."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hcbf_gym.evaluation.episode_plot import new_figure
from hcbf_lab.tuning import WINDOW, Samples

_SAMPLER_STYLES = {"normal": ("#000000", "o"), "tpe": ("#0072b2", "s"), "cmaes": ("#d55e00", "^")}


def inside(samples: Samples) -> Samples:
    """Return the samples that the paper shows, γ₀ ≤ 5 and Δγ ≤ 2.5, with a finite cost."""
    shown = (samples.gamma0 <= WINDOW["gamma0"]) & (samples.delta_gamma <= WINDOW["delta_gamma"])
    shown &= np.isfinite(samples.cost)
    return Samples(*(values[shown] for values in samples))


def draw_cost_map(axes: Axes, samples: Samples) -> None:
    """Draw r_o over (γ₀, Δγ) within the paper's window, and the cheapest sample."""
    shown = inside(samples)
    colors = axes.tricontourf(shown.gamma0, shown.delta_gamma, shown.offset, 30, cmap="viridis")
    axes.plot(shown.gamma0, shown.delta_gamma, ".", color="k", ms=1.5, alpha=0.35)
    best = shown.best
    axes.plot(
        shown.gamma0[best],
        shown.delta_gamma[best],
        "*",
        color="#e41a1c",
        mec="w",
        ms=15,
        label=f"cheapest: ({shown.gamma0[best]:.2f}, {shown.delta_gamma[best]:.2f})",
        clip_on=False,
        zorder=5,
    )
    figure = axes.get_figure()
    assert figure is not None
    figure.colorbar(colors, ax=axes, label="$r_o = r - \\min r$ [-]")
    axes.set(xlim=(0.0, WINDOW["gamma0"]), ylim=(0.0, WINDOW["delta_gamma"]))
    axes.set(xlabel="$\\gamma_0$ [-]", ylabel="$\\Delta\\gamma$ [1/m]")
    axes.legend(loc="upper left", fontsize=8)


def plot_cost_map(samples: Samples) -> Figure:
    """Return the map of r_o alone."""
    figure = new_figure(6.0, 4.2)
    draw_cost_map(figure.add_subplot(), samples)
    return figure


def plot_samplers(studies: Mapping[str, Samples]) -> Figure:
    """Return the least cost after k samples, for each sampler, above the least of all."""
    figure = new_figure(6.0, 4.0)
    axes = figure.add_subplot()
    least = min(samples.cost.min() for samples in studies.values())
    for name, samples in studies.items():
        color, marker = _SAMPLER_STYLES[name]
        gap = np.minimum.accumulate(samples.cost) - least
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
