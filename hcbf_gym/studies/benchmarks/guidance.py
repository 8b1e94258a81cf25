"""Does it arrive? Policies under a strict filter in random scenes, with guidance and without.

Every cell walks its scenes together on the reduced-order model, with the seeds 10000, 10001, …
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from hcbf_gym import guidance, policies, programs, scenarios
from hcbf_gym.barriers import BarrierSet, CbfRows
from hcbf_gym.barriers.rows import RowSettings
from hcbf_gym.envs.regions_batch import RegionsBatch
from hcbf_gym.envs.task import CONTROL_DT, MAX_EPISODE_STEPS
from hcbf_gym.errors import choose
from hcbf_gym.evaluation.measures import deadlocked
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.guidance import row as guidance_row
from hcbf_gym.policies import PDTracker, Policy

Array = NDArray[np.float64]

FIRST_SEED = 10_000
MARGIN = 0.01
"""What strict rows keep, and the field's clearance [m]."""
SETTINGS = RowSettings(period=CONTROL_DT, u_max=5.0 * np.sqrt(2.0))
"""Held rows, for the box |u_i| ≤ 5."""
CELLS = (
    ("random", "pd"),
    ("random", "ppo-unfiltered"),
    ("random-moving", "pd"),
    ("random-clutter", "pd"),
    ("random-traps", "pd"),
)
GUIDES = ("none", "geodesic", "local")
WEIGHTED: dict[str, dict[str, Any]] = {
    "r-cbf-qp": {"gamma0": 5.0, "delta_gamma": 1.3},
    "h-cbf-qp": {"gamma0": 5.0, "delta_gamma": 1.3},
    "eh-cbf-qp": {"gamma0": 3.0, "delta_gamma": 1.5},
}
"""Programs with weights, which guidance reaches by shaping u*."""
COURSES = ("paper-experiment-straight", "paper-simulation")


@dataclass(frozen=True)
class Outcome:
    """What N episodes amount to.

    Attributes:
        reached: (N,) whether the goal was reached within 20 s.
        seconds: (N,) when, infinity if it was not.
        least: (N, m) least h [m] before that.
        priority: (N, m) of the barriers.
        deadlock: (N,) share of the time that the robot stood though u* wanted to move.
        change: (N,) mean ‖u − u without the guidance row‖ at the same states [m/s²].
        final: (N,) distance from the goal at the end [m].
    """

    reached: NDArray[np.bool_]
    seconds: Array
    least: Array
    priority: NDArray[np.int64]
    deadlock: Array
    change: Array
    final: Array

    def entered(self, rank: int) -> float:
        """Return the share of the episodes that entered, or woke in, a region of that rank."""
        least = np.where(self.priority == rank, self.least, np.inf).min(axis=1)
        return float((least < 0.0).mean())


class Guide:
    """Guidance of N robots as a filter without it would use it: rows, or a shaped u*.

    Args:
        kind: one of `GUIDES`.
        barriers: of the N scenes.
        goal: (N, 2) [m].
        start: (N, 2) [m].
        through: the highest rank that may give way to guidance, 0 for none.
        is_row: whether guidance is a row of the program; else it shapes u*.
    """

    def __init__(
        self,
        kind: str,
        barriers: BarrierSet,
        goal: Array,
        start: Array,
        through: int,
        is_row: bool,
    ):
        choose("guidance", kind, dict.fromkeys(GUIDES))
        self.barriers, self.through, self.is_row = barriers, through, is_row
        self.way = guidance.Geodesic(len(goal)) if kind == "geodesic" else None
        self.round = guidance.Local(len(goal)) if kind == "local" else None
        if self.way is not None:
            self.way.reset(barriers, goal, clearance=MARGIN, start=start)
        if self.round is not None:
            self.round.reset(barriers)

    def row(self, x: Array, t: Array, u_nominal: Array) -> tuple[Array, Array] | None:
        """Return a (N, 2) and b (N,), or None without guidance."""
        if self.way is not None:
            return self.way.rows(x, t)
        if self.round is not None:
            return self.round.rows(x, t, u_nominal)
        return None

    def append(self, rows: CbfRows, a: Array, b: Array, x: Array) -> CbfRows:
        """Return the rows with the guidance row as the last entry."""
        count = len(b)
        priority = np.empty((count, rows.b.shape[1] + 1), dtype=np.int64)
        ways = self.way.reachable(x) if self.way is not None and self.through else np.zeros(count)
        for n in range(count):
            guidance_row.insert(rows.priority[n], int(ways[n]), self.through, priority[n])
        return CbfRows(
            np.concatenate([rows.a, a[:, None]], axis=1),
            np.concatenate([rows.b, b[:, None]], axis=1),
            np.concatenate([rows.h, np.ones((count, 1))], axis=1),
            priority,
        )


def episodes(
    scene: str,
    policy: str,
    count: int,
    kind: str,
    program: str = "lex-cbf-qp",
    through: int = 0,
    **options: Any,
) -> Outcome:
    """Walk `count` scenes of a family together; see `Guide` for the other arguments."""
    scenes = [scenarios.make(scene, np.random.default_rng(FIRST_SEED + n)) for n in range(count)]
    batch = RegionsBatch(scenes)
    goal = np.array([one.goal for one in scenes])
    start, is_row = batch.x[:, :2].copy(), program == "lex-cbf-qp"
    guide = Guide(kind, batch.barrier_set, goal, start, through, is_row)
    act = policy_of(policy, scene)
    solve = programs.make_batch(program, **options)
    reached, seconds = np.zeros(count, dtype=np.bool_), np.full(count, np.inf)
    deadlock, change = np.zeros(count), np.zeros(count)
    steps, radius = np.zeros(count), scenes[0].goal_radius
    observation, h, distance = batch.look()
    least = h.copy()
    for step in range(MAX_EPISODE_STEPS):
        u_nominal = np.asarray(act(observation, {}), dtype=np.float64)
        x, t, running = batch.x.copy(), batch.time, ~reached
        u, without = filtered(guide, solve, batch.barrier_set, x, t, u_nominal)
        result = batch.step(u)
        observation = result.observation
        distance = np.linalg.norm(batch.x[:, :2] - goal, axis=1)
        least[running] = np.minimum(least, result.info["min_h"])[running]
        deadlock += running & deadlocked(batch.x[:, 2:], u_nominal, distance, radius)
        change += running * np.linalg.norm(u - without, axis=1)
        steps += running
        new = running & (distance <= radius)
        seconds[new] = CONTROL_DT * (step + 1)
        reached |= new
        if reached.all():
            break
    return Outcome(
        reached,
        seconds,
        least,
        batch.barrier_set.priority.copy(),
        deadlock / steps,
        change / steps,
        np.where(reached, 0.0, distance),
    )


def filtered(
    guide: Guide,
    solve: programs.BatchProgram,
    barriers: BarrierSet,
    x: Array,
    t: Array,
    u_nominal: Array,
) -> tuple[Array, Array]:
    """Return u (N, 2) with guidance, and what it were without at the same states."""
    rows = barriers.rows(x, t, SETTINGS, MARGIN)
    without = solve(u_nominal, rows).u
    extra = guide.row(x, t, u_nominal)
    if extra is None:
        return without, without
    a, b = extra
    if guide.is_row:
        return solve(u_nominal, guide.append(rows, a, b, x)).u, without
    lack = np.maximum(0.0, b - np.sum(a * u_nominal, axis=1))
    return solve(u_nominal + lack[:, None] * a, rows).u, without


def policy_of(name: str, scene: str) -> Policy:
    """Return a policy by name for the scenes of a family."""
    env = gym.make_vec("HCBF-Regions-v0", num_envs=1, scenario=scene)
    policy = PDTracker.for_env(env) if name == "pd" else policies.load(name, env)
    env.close()
    return policy


def run(quick: bool) -> dict[str, Any]:
    """Return the share of goals and what it cost, of every cell, program and course.

    Args:
        quick: few scenes.
    """
    count = 20 if quick else 1000
    arrival = []
    for scene, policy in CELLS:
        without = episodes(scene, policy, count, "none")
        for kind in GUIDES:
            with_it = without if kind == "none" else episodes(scene, policy, count, kind)
            arrival.append({"scene": scene, "policy": policy} | _figures(kind, without, with_it))
            print(arrival[-1], flush=True)
    weighted = []
    for program, options in WEIGHTED.items():
        for kind in ("none", "geodesic"):
            outcome = episodes("random", "pd", max(20, count // 5), kind, program, **options)
            weighted.append({"program": program, "guidance": kind, **_shares(outcome)})
            print(weighted[-1], flush=True)
    courses = []
    for scene in COURSES:
        for kind, through in (("none", 0), ("geodesic", 0), ("geodesic", 2)):
            outcome = episodes(scene, "pd", 1, kind, through=through)
            courses.append({"scene": scene, "guidance": kind, "through": through}
                           | _shares(outcome) | {"final_m": float(outcome.final[0])})  # fmt: skip
            print(courses[-1], flush=True)
    return {"arrival": arrival, "weighted": weighted, "courses": courses, "cost": cost(quick)}


def _shares(outcome: Outcome) -> dict[str, Any]:
    return {
        "episodes": len(outcome.reached),
        "reached": float(outcome.reached.mean()),
        "entered": [outcome.entered(rank) for rank in (1, 2, 3)],
        "deadlock": float(outcome.deadlock.mean()),
    }


def _figures(kind: str, without: Outcome, with_it: Outcome) -> dict[str, Any]:
    """Return a row of the table; `later` and `change` over episodes that arrive without it, too."""
    both = without.reached & with_it.reached
    figures = {"guidance": kind} | _shares(with_it)
    later = with_it.seconds[both] / without.seconds[both] - 1.0
    figures["later"] = float(np.median(later)) if both.any() else 0.0
    figures["change"] = float(with_it.change[without.reached].mean()) if both.any() else 0.0
    return figures


def cost(quick: bool) -> list[dict[str, Any]]:
    """Return the time of a scene's field [ms] and of a row [µs], medians over scenes."""
    figures = []
    for scene in scenarios.RANDOM:
        scenes = [
            scenarios.make(scene, np.random.default_rng(n)) for n in range(5 if quick else 50)
        ]
        way = guidance.Geodesic()
        times = []
        for one in scenes:
            barriers = BarrierSet([one.barriers])
            begun = time.perf_counter()
            way.reset(barriers, one.goal, clearance=MARGIN, start=one.start)
            times.append(time.perf_counter() - begun)
        many = 1000
        field, geometry = np.repeat(way.field, many, axis=0), np.repeat(way.geometry, many, axis=0)
        goal = np.repeat(way.goal, many, axis=0)
        low, high = [0.0, -1.5, -1.0, -1.0], [6.0, 1.5, 1.0, 1.0]
        x = np.random.default_rng(0).uniform(low, high, (many, 4))
        a, b = np.empty((many, 2)), np.empty(many)
        rows = []
        for _ in range(5 if quick else 30):
            begun = time.perf_counter()
            guidance_row.rows(field, geometry, goal, x, way.pull, a, b)
            rows.append((time.perf_counter() - begun) / many)
        figures.append(
            {
                "scene": scene,
                "cells": int(way.geometry[0, 3] * way.geometry[0, 4]),
                "field_ms": 1e3 * float(np.median(times)),
                "row_us": 1e6 * float(np.median(rows)),
            }
        )
    return figures


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the tables of docs/guidance.md."""

    def percent(share: float) -> str:
        return f"{100.0 * share:.1f} %"

    def ranks(shares: Sequence[float]) -> str:
        return " / ".join(f"{100.0 * share:.1f}" for share in shares) + " %"

    arrival = Table(
        "arrival under lex-cbf-qp on the reduced-order model",
        ("scenes", "policy", "guidance", "arrives", "enters 1 / 2 / 3", "deadlock", "later", "Δu"),
        [
            (
                row["scene"], row["policy"], row["guidance"], percent(row["reached"]),
                ranks(row["entered"]), percent(row["deadlock"]), percent(row["later"]),
                f"{row['change']:.3f}",
            )
            for row in figures["arrival"]
        ],
    )  # fmt: skip
    weighted = Table(
        "programs with weights, PD on random",
        ("program", "guidance", "arrives", "enters 1 / 2 / 3", "deadlock"),
        [
            (row["program"], row["guidance"], percent(row["reached"]), ranks(row["entered"]),
             percent(row["deadlock"]))
            for row in figures["weighted"]
        ],
    )  # fmt: skip
    courses = Table(
        "the paper's courses, PD under lex-cbf-qp",
        ("course", "guidance", "gives way from rank", "arrives", "ends short by [m]"),
        [
            (row["scene"], row["guidance"], str(row["through"] or "–"),
             "yes" if row["reached"] else "no", f"{row['final_m']:.2f}")
            for row in figures["courses"]
        ],
    )  # fmt: skip
    times = Table(
        "what guidance costs",
        ("scenes", "cells", "field [ms]", "row [µs]"),
        [
            (row["scene"], str(row["cells"]), f"{row['field_ms']:.2f}", f"{row['row_us']:.2f}")
            for row in figures["cost"]
        ],
    )
    return {"arrival": arrival, "weighted": weighted, "courses": courses, "cost": times}
