"""Learning curves as a picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure


def plot_curves(curves: Mapping[str, Sequence[Mapping[str, float]]], path: Path) -> None:
    """Draw success and return on held-out scenes over the decisions and the time they took."""
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    by_steps, by_time = figure.subplots(1, 2, sharey=True)
    for name, curve in curves.items():
        success = [100.0 * point["success"] for point in curve]
        by_steps.plot([point["steps"] / 1e6 for point in curve], success, ".-", label=name)
        by_time.plot([point["seconds_spent"] / 60.0 for point in curve], success, ".-", label=name)
    by_steps.set(xlabel="decisions [million]", ylabel="held-out scenes solved [%]", ylim=(0, 102))
    by_time.set(xlabel="time [min]")
    for axes in (by_steps, by_time):
        axes.axhline(95.0, color="0.6", linewidth=0.8, linestyle="--")
        axes.grid(alpha=0.3)
    by_steps.legend()
    figure.savefig(path, dpi=110)
