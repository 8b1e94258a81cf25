"""Figures of rollouts: paths seen from above, and barriers, slack and tracking error over time."""

from collections.abc import Mapping

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hcbf_gym.barriers import Barrier
from hcbf_gym.drawing.palette import PROGRAM_COLORS, priority_color
from hcbf_gym.drawing.scene_plot import draw_scene, legend_below
from hcbf_gym.evaluation.rollouts import Episode
from hcbf_gym.scenarios import Scenario

_STYLES = ("-", "--", ":", "-.")


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of the given size [inch] that needs no display."""
    figure = Figure(figsize=(width, height), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def plot_paths(scenario: Scenario, episodes: Mapping[tuple[str, str], Episode]) -> Figure:
    """Return the paths in the scene, seen from above.

    Args:
        scenario: the scene that all episodes share.
        episodes: (policy, program) → an episode; programs differ in colour, policies in style.
    """
    figure = new_figure(6.4, 5.4)
    axes = figure.add_subplot()
    draw_scene(axes, scenario)
    policies = list(dict.fromkeys(policy for policy, _ in episodes))
    for (policy, program), episode in episodes.items():
        axes.plot(
            *episode.position.T,
            _STYLES[policies.index(policy) % len(_STYLES)],
            color=PROGRAM_COLORS[program],
            lw=1.8,
            zorder=4,
            label=_label(policy, program, policies),
        )
    legend_below(figure, axes)
    axes.set_title(scenario.name, fontsize=10)
    return figure


def plot_series(
    barriers: tuple[Barrier, ...], episodes: Mapping[tuple[str, str], Episode]
) -> Figure:
    """Return h_k, the summed slack and the tracking error over time.

    Args:
        barriers: those of the environment, in the order of h.
        episodes: (policy, program) → an episode.
    """
    rows = len(barriers) + 2
    figure = new_figure(7.2, 1.5 * rows)
    panels = np.atleast_1d(figure.subplots(rows, 1, sharex=True))
    policies = list(dict.fromkeys(policy for policy, _ in episodes))
    for (policy, program), episode in episodes.items():
        style = {
            "color": PROGRAM_COLORS[program],
            "ls": _STYLES[policies.index(policy) % len(_STYLES)],
            "lw": 1.3,
            "label": _label(policy, program, policies),
        }
        for k in range(len(barriers)):
            panels[k].plot(episode.time, episode.h[:, k], **style)
        panels[-2].plot(episode.time[1:], episode.slack.sum(axis=1), **style)
        panels[-1].plot(episode.time, episode.tracking_error, **style)
    for panel, barrier in zip(panels, barriers, strict=False):
        unit = "m" if barrier.reads_position else "m/s"
        panel.axhline(0.0, color=priority_color(barrier.priority), lw=0.8)
        panel.set_ylabel(f"{barrier.name}\n[{unit}]", fontsize=8)
    panels[-2].set_ylabel("slack of rows\n[m/s²]", fontsize=8)
    panels[-1].set_ylabel("tracking error\n[m]", fontsize=8)
    panels[-1].set_xlabel("t [s]")
    legend_below(figure, panels[0])
    return figure


def _label(policy: str, program: str, policies: list[str]) -> str:
    return program if len(policies) == 1 else f"{policy}, {program}"
