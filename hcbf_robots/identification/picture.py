"""Draws a robot's commands, its motion, and the fitted response."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hcbf_gym.drawing import palette
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_robots.identification.analysis import Identified

DRAWN_TIME = 20.0  # the part of the record that is drawn [s]
COMMANDED_COLOUR, FITTED_COLOUR = "0.6", "#d55e00"
LABELS = {2: ("v [m/s]", "ω [rad/s]"), 3: ("v_x [m/s]", "v_y [m/s]", "ω [rad/s]")}
"""Number of entries of a command → their labels."""


def plot(identified: Identified, title: str, path: Path) -> None:
    """Save a picture with one row for each entry of the command to an image file."""
    record, fits = identified.record, identified.fits
    samples = slice(round(DRAWN_TIME / CONTROL_DT))
    time = CONTROL_DT * np.arange(len(record.command[samples]))
    figure = Figure(figsize=(9.0, 2.1 * len(fits) + 0.4), layout="constrained")
    FigureCanvasAgg(figure)
    rows = figure.subplots(len(fits), 1, sharex=True)
    for k, (axes, label, fit) in enumerate(zip(rows, LABELS[len(fits)], fits, strict=True)):
        commanded, done = record.command[samples, k], record.done[samples, k]
        axes.step(time, commanded, where="post", color=COMMANDED_COLOUR, lw=1.2, label="commanded")
        axes.plot(time, done, color=palette.PATH, lw=1.2, label="done")
        axes.plot(time, fit.predicted[samples], "--", color=FITTED_COLOUR, lw=1.0, label="fitted")
        axes.set_ylabel(label)
        numbers = f"gain {fit.gain:.2f}, τ {fit.time_constant:.2f} s, delay {fit.delay:.2f} s"
        axes.set_title(numbers, fontsize=8, loc="right")
        axes.grid(alpha=0.3)
    rows[0].set_title(title, loc="left")
    rows[0].legend(ncols=3, fontsize=8, loc="upper left")
    rows[-1].set_xlabel("time [s]")
    figure.savefig(path, dpi=110)
