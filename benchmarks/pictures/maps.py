"""Draw a floor plan three times: its ranks, the pieces that cover it, and the field to a goal."""

from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from hcbf_gym import _core, guidance, scenarios
from hcbf_gym.drawing import palette
from hcbf_gym.drawing.scene_plot import draw_map
from hcbf_gym.guidance import field as fields
from hcbf_gym.scenarios import Scenario


def picture(path: Path, scene: str = "map-flat", seed: int = 2) -> None:
    """Draw a plan's ranks, its cover, and the field with the path down it from the start."""
    scenario = scenarios.make(scene, np.random.default_rng(seed))
    assert scenario.map is not None
    figure, (ranks, cover, field) = plt.subplots(1, 3, figsize=(15.0, 4.2), sharey=True)
    draw_map(ranks, scenario.map)
    draw_map(cover, scenario.map, covered=True)
    draw_map(field, scenario.map)
    _field(field, scenario)
    low, high = scenario.map.grid.corners.min(axis=0), scenario.map.grid.corners.max(axis=0)
    titles = "ranks, and speed zones dotted", "pieces that cover them", "the field to the goal"
    for axes, title in zip((ranks, cover, field), titles, strict=True):
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", title=title)
        axes.set(xlabel="$p_x$ [m]", ylabel="$p_y$ [m]")
        axes.label_outer()
    figure.savefig(path, dpi=80, bbox_inches="tight")
    plt.close(figure)


def _field(axes: Axes, scenario: Scenario) -> None:
    """Draw the level lines of the field, and the way down from the start."""
    way = guidance.Geodesic()
    way.reset(scenario.conditions, scenario.goal, start=scenario.start, clearance=0.3)
    geometry, goal = way.geometry[0], way.goal[0]
    values = fields.grid(way.field[0], geometry)
    rows, columns = np.indices(values.shape)
    x, y = fields.to_world(rows, columns, geometry)
    seen = np.where(np.isfinite(values), values, np.nan)
    axes.contour(x, y, seen, levels=np.arange(0.0, 30.0, 0.5), colors="0.4", linewidths=0.5)
    points = [np.array(scenario.start)]
    while np.linalg.norm(points[-1] - goal) > 1e-9 and len(points) < values.size:
        x, y = points[-1]
        points.append(np.array(_core.field_descent(values, geometry, goal, x, y, geometry[2])))
    axes.plot(*np.array(points).T, color=palette.PATH, linewidth=2.0)
    axes.plot(*scenario.start, "o", color="white", markeredgecolor="black")
    axes.plot(*scenario.goal, "*", color="white", markeredgecolor="black", markersize=12)


@dataclass(frozen=True)
class Args:
    """Where the picture goes."""

    output: Path = Path("docs/images")
    """Folder for the file."""


def main(args: Args) -> None:
    """Draw the picture."""
    args.output.mkdir(parents=True, exist_ok=True)
    picture(args.output / "map-flat.png")
