"""Draw fields with ranked costs and paths: in a scene, on a floor plan, and out of a deadlock."""

import itertools
from math import ceil
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.pictures.canvas import Args, plt, save
from hcbf_gym import _core, guidance, scenarios
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import BarrierSet
from hcbf_gym.drawing import palette
from hcbf_gym.drawing.scene_plot import draw_map
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation.episode import samples
from hcbf_gym.guidance import field as fields
from hcbf_gym.policies import PDTracker
from hcbf_gym.scenarios import Scenario
from hcbf_gym.wrappers import SafetyFilter

__all__ = ["Args", "main"]

STRIP = (5.0, 10.0, 15.0)  # When the strip looks at the robot [s]


def scene_picture(path: Path) -> None:
    """Draw the field of a scene, its level lines, and the path down the field from the start."""
    scenario = scenarios.make("random-clutter", np.random.default_rng(10_004))
    figure, axes = plt.subplots(figsize=(8.0, 4.2))
    _regions(axes, scenario)
    _field(axes, scenario)
    save(figure, path, 80)


def map_picture(path: Path) -> None:
    """Draw the field of a floor plan, its level lines, and a path down it."""
    scenario = scenarios.make("map-flat", np.random.default_rng(3))
    assert scenario.map is not None
    figure, axes = plt.subplots(figsize=(8.0, 6.0))
    draw_map(axes, scenario.map)
    _field(axes, scenario)
    save(figure, path, 80)


def cover_picture(path: Path) -> None:
    """Draw a plan's ranks, its cover, and the field with the path down it from the start."""
    scenario = scenarios.make("map-flat", np.random.default_rng(2))
    assert scenario.map is not None
    figure, row = plt.subplots(1, 3, figsize=(15.0, 4.2), sharey=True)
    low, high = scenario.map.grid.corners.min(axis=0), scenario.map.grid.corners.max(axis=0)
    titles = "ranks, and speed zones dotted", "pieces that cover them", "the field to the goal"
    for k, (axes, title) in enumerate(zip(row, titles, strict=True)):
        draw_map(axes, scenario.map, covered=k == 1)
        if k == 2:
            _field(axes, scenario)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), title=title)
        _label(axes)
    save(figure, path, 80)


def escape_strip(path: Path) -> None:
    """Draw PD under lex-cbf-qp at three times, without guidance above and with it below."""
    scenario = scenarios.make("random-traps", np.random.default_rng(10_001))
    figure, rows = plt.subplots(2, len(STRIP), figsize=(11.0, 5.2), sharex=True, sharey=True)
    for kind, line in zip((None, "geodesic"), rows, strict=True):
        walked = walk(scenario, kind, STRIP[-1])
        for axes, until in zip(line, STRIP, strict=True):
            _regions(axes, scenario)
            so_far = walked[: int(until / CONTROL_DT)]
            axes.plot(so_far[:, 0], so_far[:, 1], "k-")
            axes.plot(*so_far[-1], "ko")
            _ends(axes, scenario)
            axes.set_title(f"{'guided' if kind == 'geodesic' else 'not guided'}, {until:.0f} s")
    save(figure, path, 60)


def walk(scenario: Scenario, kind: str | None, until: float) -> Array:
    """Return (k, 2) where PD gets under lex-cbf-qp; it stays where it is at the goal."""
    env: Any = gym.make("HCBF-Regions-v0", scenario=scenario)
    env = SafetyFilter(env, "lex-cbf-qp", guidance=kind)
    walked = itertools.islice(samples(env, PDTracker.for_env(env), 0), ceil(until / CONTROL_DT))
    positions = [env.unwrapped.rom_state[:2] for _ in walked]
    env.close()
    return np.array(positions)


def _field(axes: Any, scenario: Scenario) -> None:
    """Draw the level lines of the field of a scene or its map, and the path down from the start."""
    guide = guidance.Geodesic()
    clearance = 0.0 if scenario.map is None else 0.3
    guide.reset(scenario.conditions, scenario.goal, None, clearance, start=scenario.start)
    geometry, goal = guide.geometry[0], guide.goal[0]
    values = fields.grid(guide.field[0], geometry)
    rows, columns = np.indices(values.shape)
    x, y = fields.to_world(rows, columns, geometry)
    seen = np.where(np.isfinite(values), values, np.nan)
    axes.contour(x, y, seen, levels=np.arange(0.0, 40.0, 0.5), colors="0.35", linewidths=0.5)
    points = [np.array(scenario.start)]
    while np.linalg.norm(points[-1] - goal) > 1e-9 and len(points) < values.size:
        x, y = points[-1]
        points.append(np.array(_core.field_descent(values, geometry, goal, x, y, geometry[2])))
    axes.plot(*np.array(points).T, color=palette.PATH, linewidth=2.0)
    _ends(axes, scenario)


def _regions(axes: Any, scenario: Scenario) -> None:
    """Fill the regions in the colours of their ranks, the highest on top."""
    x, y = np.linspace(-0.8, scenario.goal[0] + 0.8, 220), np.linspace(-3.2, 3.2, 160)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    state = np.hstack([points, np.zeros_like(points)])
    h = BarrierSet([scenario.barriers]).along(state, np.zeros(len(state)))
    rank = np.array([barrier.priority for barrier in scenario.barriers])
    for priority in sorted(set(rank.tolist()), reverse=True):
        color = palette.paler(palette.priority_color(priority))
        inside = h[:, rank == priority].min(axis=1).reshape(len(y), len(x)) < 0.0
        axes.contourf(x, y, inside, levels=[0.5, 1.5], colors=[color])


def _ends(axes: Any, scenario: Scenario) -> None:
    """Mark start and goal."""
    axes.plot(*scenario.start, "o", color="white", markeredgecolor="black")
    axes.plot(*scenario.goal, "*", color="white", markeredgecolor="black", markersize=12)
    _label(axes)


def _label(axes: Any) -> None:
    axes.set(aspect="equal", xlabel="$p_x$ [m]", ylabel="$p_y$ [m]")
    axes.label_outer()


def main(args: Args) -> None:
    """Draw the pictures."""
    cover_picture(args.output / "map-flat.png")
    map_picture(args.output / "map-guidance-field.png")
    scene_picture(args.output / "guidance-field.png")
    escape_strip(args.output / "guidance-escape.png")
