"""Draw for `docs/rows.md` how h moves between samples, under usual and under held rows."""

import numpy as np

from benchmarks.pictures.canvas import Args, plt, save
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Disc, RowSettings
from hcbf_gym.barriers.planar_rows import planar_rows
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.drawing.palette import priority_color

PERIOD, U_MAX, RADIUS = 0.05, 5.0, 0.3
"""How long an input is held [s], the largest input [m/s²], the disc's radius [m]."""
SECONDS = 4.0
FINE = 40  # Points drawn in a period


def main(args: Args) -> None:
    """Draw h over time at a disc; the policy presses against it, and slides to and fro."""
    figure, axes = plt.subplots(figsize=(7.6, 3.2), layout="constrained")
    held = RowSettings(period=PERIOD, u_max=U_MAX)
    for name, how, color in (
        ("usual row", RowSettings(), "#7f7f7f"),
        ("held row", held, "#0072b2"),
    ):
        time, h = drive(how)
        axes.plot(time, 1000.0 * h, color=color, label=name)
        axes.plot(time[::FINE], 1000.0 * h[::FINE], "o", color=color, markersize=3.5)
        print(f"{name}: least h {1000.0 * h.min():+.1f} mm")
    axes.axhspan(-60.0, 0.0, color=priority_color(1), alpha=0.25)
    axes.set(xlabel=f"time [s]; a dot every {PERIOD} s is a sample", ylabel="h [mm]")
    axes.set(xlim=(1.0, SECONDS), ylim=(-30.0, 60.0))
    axes.legend(frameon=False, loc="upper right")
    save(figure, args.output / "between_samples.png", 110)


def drive(how: RowSettings) -> tuple[Array, Array]:
    """Return times (n,) [s] and h (n,) [m] of a drive along a disc under its row."""
    barriers = BarrierSet([[Disc("disc", 1, center=(0.0, 0.0), radius=RADIUS)]])
    x = np.array([RADIUS + 0.3, 0.0, 0.0, 0.0])
    times, heights = [np.zeros(1)], [np.array([0.3])]
    tau = PERIOD * np.arange(1, FINE + 1) / FINE
    for k in range(round(SECONDS / PERIOD)):
        row = planar_rows(barriers, x[None], np.zeros(1), how)
        a, u = row.a[0, 0], nominal(k * PERIOD, x)
        u = u + max(0.0, float(row.b[0, 0]) - a @ u) * a / (a @ a)
        path = x[:2] + x[2:] * tau[:, None] + 0.5 * u * tau[:, None] ** 2
        times.append(k * PERIOD + tau)
        heights.append(np.hypot(*path.T) - RADIUS)
        x = np.concatenate([path[-1], x[2:] + u * PERIOD])
    return np.concatenate(times), np.concatenate(heights)


def nominal(t: float, x: Array) -> Array:
    """Return the input (2,) that presses against the disc and slides along it, to and fro."""
    outward = x[:2] / np.hypot(*x[:2])
    along = np.array([-outward[1], outward[0]])
    speed = 1.2 * np.sign(np.sin(2.0 * np.pi * t / 0.6))
    return -5.0 * outward + 4.0 * np.clip(3.0 * (speed - along @ x[2:]), -1.0, 1.0) * along
