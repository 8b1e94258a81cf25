"""Does it arrive? Policies under a strict filter in random scenes, with guidance and without.

Scenes have the seeds 10000, 10001, … On the reduced-order model those of a cell walk together; the
A1 walks them one by one. Both go through the wrappers, as a user's loop does.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from rich.progress import track

from benchmarks.common import parallel, table
from hcbf_gym import policies
from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation.episode import samples
from hcbf_gym.evaluation.measures import deadlocked
from hcbf_gym.evaluation.statistics import BOUNDED, INTERVAL, at_most, shown_share
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.policies import PDTracker, learned
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter

FIRST_SEED = 10_000


class Cell(NamedTuple):
    """Scenes of a family, and who walks them under which filter."""

    scene: str  # a family's name
    policy: str  # as `policies.make` takes it
    guidance: Any = None  # as the filter takes it


ARRIVAL = (
    ("random", "pd"),
    ("random", "ppo-unfiltered"),
    ("random-moving", "pd"),
    ("random-clutter", "pd"),
    ("random-traps", "pd"),
)
ON_A1 = (
    ("random", "pd", (None, "geodesic")),
    *(("random", name, ("geodesic",)) for name in learned.names()),
    ("random-clutter", "pd", ("geodesic",)),
)
KINDS = (None, "geodesic", "local")


@dataclass(frozen=True)
class Outcome:
    """What N episodes amount to."""

    reached: Mask  # (N,) whether the goal was reached within 20 s, without a fall
    seconds: Array  # (N,) when, infinity if it was not
    least: Array  # (N, m) least h of the true body [m] before that
    priority: Integers  # (N, m) of the barriers
    deadlock: Array  # (N,) share of the time that the robot stood though u* wanted to move
    fell: Mask  # (N,) whether the robot fell

    def entered(self, rank: int) -> float:
        """Return the share of the episodes that entered, or woke in, a region of that rank."""
        least = np.where(self.priority == rank, self.least, np.inf).min(axis=1)
        return float((least < 0.0).mean())


class Nominal:
    """A policy that retains its last input."""

    def __init__(self, act: Any):
        self._act, self.wanted = act, np.zeros((1, 2))

    def __call__(self, observation: Any, info: Any) -> Array:
        """Return u*."""
        u = np.asarray(self._act(observation, info), dtype=np.float64)
        self.wanted = np.atleast_2d(u)
        return u


def on_model(cell: Cell, count: int) -> Outcome:
    """Walk `count` scenes together on the reduced-order model."""
    env: Any = gym.make_vec(
        "HCBF-Regions-v0", num_envs=count, scenario=cell.scene, autoreset_mode="Disabled"
    )
    env = VectorSafetyFilter(env, guidance=cell.guidance)
    act = PDTracker.for_env(env) if cell.policy == "pd" else policies.load(cell.policy, env)
    return _walked(env, Nominal(act), FIRST_SEED, count)


def on_a1(cell: Cell, count: int) -> Outcome:
    """Walk `count` scenes on the A1, one after the other on each core."""
    walks = parallel(a1_episode, ((cell, FIRST_SEED + n) for n in range(count)))
    fields = zip(*(vars(one).values() for one in walks), strict=True)
    return Outcome(*(np.concatenate(field) for field in fields))


def a1_episode(cell: Cell, seed: int) -> Outcome:
    """Walk one scene on the A1; the goal and h are the true trunk's."""
    env: Any = gym.make("HCBF-A1Regions-v0", scenario=cell.scene)
    env = SafetyFilter(env, guidance=cell.guidance)
    return _walked(env, Nominal(policies.make(cell.policy, env)), seed, 1)


def _walked(env: Any, act: Nominal, seed: int, count: int) -> Outcome:
    """Walk the scenes of an environment until all goals are reached, or the episodes end."""
    inner, walk = env.unwrapped, samples(env, act, seed)
    info = next(walk).info
    least = np.atleast_2d(info["min_h"]).copy()
    scenes = getattr(inner, "scenes", None) or [inner.scenario]
    goal, radius = np.array([one.goal for one in scenes]), scenes[0].goal_radius
    reached, seconds = np.zeros(count, dtype=np.bool_), np.full(count, np.inf)
    deadlock, steps = np.zeros((2, count))
    distance = np.full(count, np.inf)
    for step, (_, info, *_) in enumerate(walk, 1):
        running, x = ~reached, np.atleast_2d(inner.rom_state)
        least[running] = np.minimum(least, info["min_h"])[running]
        distance[running] = np.linalg.norm(x[:, :2] - goal, axis=1)[running]
        deadlock += running & deadlocked(x[:, 2:], act.wanted, distance, radius)
        steps += running
        seconds[running & (distance <= radius)] = CONTROL_DT * step
        reached |= distance <= radius
        if reached.all():
            break
    env.close()
    fell = np.zeros_like(reached) | (np.asarray(info.get("fallen", 0.0)) > 0.0)
    return Outcome(
        reached & ~fell, seconds, least, inner.barrier_set.priority.copy(), deadlock / steps, fell,
    )  # fmt: skip


def run(quick: bool) -> dict[str, Any]:
    """Return the share of goals of every cell."""
    count, on_robot = (20, 1) if quick else (2000, 300)
    arrival = []
    for scene, policy in track(ARRIVAL, "reduced order"):
        without = on_model(Cell(scene, policy), count)
        for kind in KINDS:
            outcome = without if kind is None else on_model(Cell(scene, policy, kind), count)
            arrival.append(_figures(Cell(scene, policy, kind), without, outcome))
    robot = []
    for scene, policy, kinds in track(ON_A1[:: 5 if quick else 1], "A1"):
        outcomes = {kind: on_a1(Cell(scene, policy, kind), on_robot) for kind in kinds}
        for kind, outcome in outcomes.items():
            robot.append(_figures(Cell(scene, policy, kind), outcomes.get(None), outcome))
    return {"arrival": arrival, "A1": robot}


def _shares(outcome: Outcome) -> dict[str, Any]:
    return {
        "episodes": len(outcome.reached),
        "reached": float(outcome.reached.mean()),
        "entered": [outcome.entered(rank) for rank in (1, 2, 3)],
        "deadlock": float(outcome.deadlock.mean()),
        "fell": float(outcome.fell.mean()),
    }


def _figures(cell: Cell, without: Outcome | None, with_it: Outcome) -> dict[str, Any]:
    """Return a row of the table; `later` is of episodes that arrive without it, too."""
    figures = {"scene": cell.scene, "policy": cell.policy, "guidance": cell.guidance}
    figures |= _shares(with_it) | {"later": None}
    if without is not None:
        both = without.reached & with_it.reached
        if both.any():
            later = with_it.seconds[both] / without.seconds[both] - 1.0
            figures["later"] = float(np.median(later))
    return figures


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the tables of docs/guidance.md."""

    def percent(key: str) -> Callable[[Any], str]:
        return lambda row: "" if row[key] is None else f"{100.0 * row[key]:.1f} %"

    def ranks(row: dict[str, Any]) -> str:
        shares, n = row["entered"], row["episodes"]
        shown = " / ".join(f"{100.0 * share:.1f}" for share in shares) + " %"
        return f"{shown} ({at_most(round(shares[0] * n), n)})"

    enters = f"enters 1 / 2 / 3 (1 {BOUNDED})"
    arrival = {
        "scenes": "{scene}", "policy": "{policy}",
        "guidance": lambda row: row["guidance"] or "none", "episodes": "{episodes}",
        f"arrives [%, {INTERVAL:.0%} interval]": lambda row: shown_share(
            row["reached"], row["episodes"]
        ),
        enters: ranks, "falls": percent("fell"), "deadlock": percent("deadlock"),
        "later": percent("later"),
    }  # fmt: skip
    return {
        "arrival": table("lex-cbf-qp on the reduced-order model", figures["arrival"], arrival),
        "arrival-a1": table("lex-cbf-qp on the A1", figures["A1"], arrival),
    }
