"""What a walker was commanded beside what it did, as a picture."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hcbf_gym.drawing import palette
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_robots.identification.analysis import Identified

SHOWN = 20.0  # how much of the record is drawn [s]
NAMES = {2: ("v [m/s]", "ω [rad/s]"), 3: ("v_x [m/s]", "v_y [m/s]", "ω [rad/s]")}
"""Of the command's entries, by how many there are."""


def plot(identified: Identified, title: str, path: Path) -> None:
    """Draw every entry of the command: commanded, done, and the fitted response."""
    record, fits = identified.record, identified.fits
    shown = round(SHOWN / CONTROL_DT)
    time = CONTROL_DT * np.arange(len(record.command[:shown]))
    figure = Figure(figsize=(9.0, 2.1 * len(fits) + 0.4), layout="constrained")
    FigureCanvasAgg(figure)
    rows = figure.subplots(len(fits), 1, sharex=True)
    for k, (axes, name, fit) in enumerate(zip(rows, NAMES[len(fits)], fits, strict=True)):
        axes.step(
            time, record.command[:shown, k], where="post", color="0.6", lw=1.2, label="commanded"
        )
        axes.plot(time, record.done[:shown, k], color=palette.PATH, lw=1.2, label="done")
        axes.plot(time, fit.predicted[:shown], "--", color="#d55e00", lw=1.0, label="fitted")
        axes.set_ylabel(name)
        axes.set_title(
            f"gain {fit.gain:.2f}, τ {fit.time_constant:.2f} s, delay {fit.delay:.2f} s",
            fontsize=8,
            loc="right",
        )
        axes.grid(alpha=0.3)
    rows[0].set_title(title, loc="left")
    rows[0].legend(ncols=3, fontsize=8, loc="upper left")
    rows[-1].set_xlabel("time [s]")
    figure.savefig(path, dpi=110)
