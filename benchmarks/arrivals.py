"""Do guided robots arrive? Fresh random scenes, PD under guidance and filter, robot by robot.

    python -m benchmarks.arrivals --robots cart tests/robots/contracts/go1.json --count 100

A line for each family: arrived, entered (the truth, at every physics step), fallen, the longest
stand, and the seeds that did not arrive. A stand lasts while the robot stays within 3 cm and
.1 rad of where it began; where something moves it may be waiting, which is counted alike.
"""

import math
import warnings
from pathlib import Path
from typing import Any, NamedTuple, cast

import gymnasium as gym
import joblib
import tyro

from hcbf_gym import policies
from hcbf_gym.evaluation.attacked import truth_of
from hcbf_gym.evaluation.episode import in_double, samples
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers import SafetyFilter

FAMILIES = ("random", "random-moving", "random-traps", "random-clutter", "random-map")
FIRST_SEED = 96_000
STAYS = 0.03
"""Distance from where a stand began up to which it goes on [m]."""
TURNS = 0.1
"""Likewise its turn [rad]."""
VIOLATED = (FilterStatus.VIOLATED, FilterStatus.UNSAFE)


class Arrival(NamedTuple):
    """How a guided episode went.

    Attributes:
        seed: of its scene.
        arrived: whether it reached the goal.
        entered: whether it entered rank 1.
        fell: whether the robot fell.
        stand: the longest one [s].
        violated: share of steps that the filter calls VIOLATED or UNSAFE.
    """

    seed: int
    arrived: bool
    entered: bool
    fell: bool
    stand: float
    violated: float


def walk(robot: str, family: str, seeds: range) -> list[Arrival]:
    """Return how a robot's episodes went.

    Args:
        robot: a contract's path or name.
        family: of scenes.
        seeds: of the scenes.
    """
    warnings.simplefilter("ignore")
    env = gym.make("hcbf_robots:HCBF-WalkerRegions-v0", robot=robot, scenario=family)
    filtered = SafetyFilter(env, guidance="geodesic")
    act, look = in_double(policies.make("pd", filtered)), truth_of(env.unwrapped)
    return [_walk(filtered, act, look, seed) for seed in seeds]


def _walk(env: Any, act: Any, look: Any, seed: int) -> Arrival:
    simulation = env.unwrapped.simulation
    following = samples(env, act, seed)
    sample = next(following)
    now = look(sample)
    since, stand, least, bad, steps = (now.time, *now.x[:2], simulation.yaw), 0.0, now.h, 0, 0
    for sample in following:
        now = look(sample)
        least = min(least, now.h, now.speed_h)
        here = (now.time, *now.x[:2], simulation.yaw)
        moved = math.hypot(here[1] - since[1], here[2] - since[2])
        if moved > STAYS or abs(math.remainder(here[3] - since[3], math.tau)) > TURNS:
            since = here
        stand = max(stand, now.time - since[0])
        bad += sample.info["safety_filter"]["status"] in (
            FilterStatus.VIOLATED,
            FilterStatus.UNSAFE,
        )
        steps += 1
    reached = bool(sample.terminated) and bool(sample.info["is_success"])
    fell = bool(sample.info["fallen"])
    return Arrival(seed, reached, least < 0.0, fell, stand, bad / steps)


def main(
    robots: tuple[str, ...] = ("cart", "holonomic-cart"),
    families: tuple[str, ...] = FAMILIES,
    count: int = 100,
    workers: int = 2,
) -> None:
    """Print a line for each robot and family.

    Args:
        robots: contracts' paths or names.
        families: of random scenes.
        count: scenes of each.
        workers: that run at once.
    """
    for robot in robots:
        for family in families:
            parts = [
                range(first, min(first + 10, FIRST_SEED + count))
                for first in range(FIRST_SEED, FIRST_SEED + count, 10)
            ]
            jobs = (joblib.delayed(walk)(robot, family, part) for part in parts)
            done = cast("list[list[Arrival]]", joblib.Parallel(n_jobs=workers)(jobs))
            runs = [run for part in done for run in part]
            lost = [run.seed for run in runs if not run.arrived]
            longest = max(runs, key=lambda run: run.stand)
            print(
                f"{Path(robot).stem}: {family}: {count - len(lost)} of {count} arrive, "
                f"{sum(run.entered for run in runs)} entered, "
                f"{sum(run.fell for run in runs)} fell, "
                f"longest stand {longest.stand:.2f} s (seed {longest.seed}), "
                f"{sum(run.stand > 0.5 for run in runs)} above .5 s, VIOLATED or UNSAFE "
                f"{100.0 * sum(run.violated for run in runs) / count:.3f} %, not arrived: {lost}",
                flush=True,
            )


if __name__ == "__main__":
    tyro.cli(main)
