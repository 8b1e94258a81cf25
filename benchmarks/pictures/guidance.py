"""Draw a field with ranked costs and a path, and a deadlock beside its escape."""

import itertools
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

from hcbf_gym import _core, guidance, scenarios
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import BarrierSet
from hcbf_gym.drawing import palette
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation.episode import samples
from hcbf_gym.guidance import field as fields
from hcbf_gym.policies import PDTracker
from hcbf_gym.scenarios import Scenario
from hcbf_gym.wrappers import SafetyFilter
from hcbf_robots.maps import RankedMap

STRIP = (5.0, 10.0, 15.0)
"""When the strip looks at the robot [s]."""


def field_picture(path: Path, scene: str = "random-clutter", seed: int = 10_004) -> None:
    """Draw the field of a scene, its level lines, and the path down the field from the start."""
    scenario = scenarios.make(scene, np.random.default_rng(seed))
    way = guidance.Geodesic()
    way.reset(scenario.barriers, scenario.goal, start=scenario.start)
    view, geometry, goal = fields.grid(way.field[0], way.geometry[0]), way.geometry[0], way.goal[0]
    points = [np.array(scenario.start)]
    while np.linalg.norm(points[-1] - goal) > 1e-9:
        x, y = points[-1]
        points.append(np.array(_core.field_descent(view, geometry, goal, x, y, geometry[2])))
    x = geometry[0] + geometry[2] * np.arange(view.shape[1])
    y = geometry[1] + geometry[2] * np.arange(view.shape[0])
    figure, axes = plt.subplots(figsize=(8.0, 4.2))
    _regions(axes, scenario, x, y)
    levels = np.arange(0.0, 16.0, 0.5)
    axes.contour(x, y, view, levels=levels, colors="0.35", linewidths=0.5)
    line = np.array(points)
    axes.plot(line[:, 0], line[:, 1], "k-", linewidth=2.0)
    _finish(axes, scenario)
    figure.savefig(path, dpi=80, bbox_inches="tight")
    plt.close(figure)


def map_picture(path: Path, scene: str = "map-flat", seed: int = 3) -> None:
    """Draw the field of a floor plan, its level lines, and a way down it."""
    scenario = scenarios.make(scene, np.random.default_rng(seed))
    floor = scenario.map
    assert isinstance(floor, RankedMap)
    way = guidance.Geodesic()
    way.reset(scenario.conditions, scenario.goal, clearance=0.3, start=scenario.start)
    view, geometry, goal = fields.grid(way.field[0], way.geometry[0]), way.geometry[0], way.goal[0]
    points = [np.array(scenario.start)]
    while np.linalg.norm(points[-1] - goal) > 1e-9:
        x, y = points[-1]
        points.append(np.array(_core.field_descent(view, geometry, goal, x, y, geometry[2])))
    cells = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in view.shape[::-1])), axis=-1)
    x, y = floor.grid.to_world(cells.reshape(-1, 2)).T.reshape(2, *view.shape)
    figure, axes = plt.subplots(figsize=(8.0, 6.0))
    for one in sorted(floor.classes, key=lambda c: -c.rank):
        if one.kind != "speed" and one.cells.any():
            color = palette.paler(palette.priority_color(one.rank))
            axes.contourf(x, y, one.cells, levels=[0.5, 1.5], colors=[color])
    axes.contour(x, y, view, levels=np.arange(0.0, 40.0, 0.5), colors="0.35", linewidths=0.5)
    axes.plot(*np.array(points).T, "k-", linewidth=2.0)
    _finish(axes, scenario)
    figure.savefig(path, dpi=80, bbox_inches="tight")
    plt.close(figure)


def escape_strip(path: Path, scene: str = "random-traps", seed: int = 10_001) -> None:
    """Draw PD under lex-cbf-qp at three times, without guidance above and with it below."""
    scenario = scenarios.make(scene, np.random.default_rng(seed))
    figure, rows = plt.subplots(2, len(STRIP), figsize=(11.0, 5.2), sharex=True, sharey=True)
    x, y = np.linspace(-0.8, scenario.goal[0] + 0.8, 220), np.linspace(-3.2, 3.2, 160)
    for kind, line in zip((None, "geodesic"), rows, strict=True):
        walked = walk(scenario, kind, STRIP[-1])
        for axes, until in zip(line, STRIP, strict=True):
            _regions(axes, scenario, x, y)
            so_far = walked[: int(until / CONTROL_DT)]
            axes.plot(so_far[:, 0], so_far[:, 1], "k-")
            axes.plot(*so_far[-1], "ko")
            _finish(axes, scenario)
            axes.set_title(f"{'guided' if kind == 'geodesic' else 'not guided'}, {until:.0f} s")
    figure.savefig(path, dpi=60, bbox_inches="tight")
    plt.close(figure)


def walk(scenario: Scenario, kind: str | None, until: float) -> Array:
    """Return (k, 2) where PD gets under lex-cbf-qp; it stays where it is at the goal."""
    env: Any = gym.make("HCBF-Regions-v0", scenario=scenario)
    env = SafetyFilter(env, "lex-cbf-qp", guidance=kind)
    walked = itertools.islice(samples(env, PDTracker.for_env(env), 0), ceil(until / CONTROL_DT))
    positions = [env.unwrapped.rom_state[:2] for _ in walked]
    env.close()
    return np.array(positions)


def _regions(axes: Any, scenario: Scenario, x: Array, y: Array) -> None:
    """Fill the regions in the colours of their ranks, the highest on top."""
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    state = np.hstack([points, np.zeros_like(points)])
    h = BarrierSet([scenario.barriers]).along(state, np.zeros(len(state)))
    rank = np.array([barrier.priority for barrier in scenario.barriers])
    for priority in sorted(set(rank.tolist()), reverse=True):
        color = palette.paler(palette.priority_color(priority))
        inside = h[:, rank == priority].min(axis=1).reshape(len(y), len(x)) < 0.0
        axes.contourf(
            x,
            y,
            inside,
            levels=[0.5, 1.5],
            colors=[color],
        )


def _finish(axes: Any, scenario: Scenario) -> None:
    axes.plot(*scenario.start, "o", color="white", markeredgecolor="black")
    axes.plot(*scenario.goal, "*", color="white", markeredgecolor="black", markersize=12)
    axes.set(aspect="equal", xlabel="$p_x$ [m]", ylabel="$p_y$ [m]")
    axes.label_outer()


@dataclass(frozen=True)
class Args:
    """Where the pictures go."""

    output: Path = Path("docs/images")
    """Folder for the files."""


def main(args: Args) -> None:
    """Draw the pictures."""
    args.output.mkdir(parents=True, exist_ok=True)
    map_picture(args.output / "map-guidance-field.png")
    field_picture(args.output / "guidance-field.png")
    escape_strip(args.output / "guidance-escape.png")
