"""A planner whose commands CMA-ES trains against `VelocityFilter`, and a loop of 100,000 steps.

    python -m benchmarks.command_attack --robot cart

The planner is linear in eight features of what it sees: in the robot's axes the direction to the
nearest strict region and to the second, tanh of the nearest one's h over .3 m, a wave and a sign
that changes at random. Training lowers the mean of the least distance; fresh scenes then tell
whether it enters, beside the planner that training began from. The long loop prints what memory
the process has held and how long a step takes, fifth by fifth.
"""

import math
import resource
import time
import warnings
from collections.abc import Sequence

import numpy as np
import tyro

from benchmarks.own_loop import LONGEST, Driven, Moving, Planner, boxes_of, hostile, loop
from benchmarks.wheels import MAX_AGE
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import require
from hcbf_robots import VelocityFilter
from hcbf_robots.walkers.walker import Walker

FEATURES = 8
SEED, FRESH = 21, 5_000
POPULATION, SPREAD = 16, 0.5
SECONDS = 12.0


def planner(
    parameters: Array, walls: Sequence[Barrier], walker: Walker, rng: np.random.Generator
) -> Planner:
    """Return a planner that tells the full limits times W φ, each entry cut to [−1, 1].

    Args:
        parameters: (8 k + 2,) W row by row, log₂ of the wave's period and of the mean time between
            changes of the sign [s].
        walls: what it drives at.
        walker: its robot, with k entries of a command.
        rng: of the sign.
    """
    limits = walker.command.limits
    weights = parameters[:-2].reshape(len(limits), FEATURES)
    period, hold = np.exp2(np.clip(parameters[-2:], -3.0, 3.0))
    now, sign, until = 0.0, 1.0, 0.0

    def plan(pose: Array) -> Array:
        nonlocal now, sign, until
        now += LONGEST
        if now >= until:
            sign, until = rng.choice([-1.0, 1.0]), now + hold * rng.uniform(0.5, 1.5)
        x = np.array([*pose[:2], 0.0, 0.0])
        one, two = sorted(walls, key=lambda wall: wall.h(x))[:2]
        features = [1.0, math.tanh(one.h(x) / 0.3)]
        for wall in (one, two):
            n = -wall.jet(x).gradient[:2]
            angle = math.atan2(n[1], n[0]) - pose[2]
            features += [math.cos(angle), math.sin(angle)]
        features += [math.cos(math.tau * now / period), sign]
        return limits * np.clip(weights @ np.array(features), -1.0, 1.0)

    return plan


def attacked(parameters: Array, walker: Walker, seed: int) -> Driven:
    """Return a loop of `SECONDS` among six boxes under the planner."""
    rng = np.random.default_rng([SEED, seed])
    boxes = boxes_of(rng)
    door = VelocityFilter(walker, boxes, period=LONGEST, max_age=MAX_AGE)
    plan = planner(parameters, boxes, walker, rng)
    return loop(door, Moving(walker, np.zeros(3), seed), plan, walker.reach, SECONDS, seed=seed)


def train(walker: Walker, generations: int, scenes: int) -> tuple[Array, Array]:
    """Return the parameters from which training begins, and those where it ends."""
    require("benchmarks.command_attack", "studies", "cmaes")
    from cmaes import CMA

    size = FEATURES * len(walker.command.limits) + 2
    first = np.zeros(size)
    first[2], first[-2 - FEATURES + 3] = 1.0, 1.0  # ahead along cos, turn along sin
    search = CMA(mean=first, sigma=SPREAD, population_size=POPULATION, seed=SEED)
    for generation in range(generations):
        seeds = range(generation * scenes, (generation + 1) * scenes)
        asked = [search.ask() for _ in range(POPULATION)]
        least = [
            float(np.mean([attacked(one, walker, seed).least for seed in seeds])) for one in asked
        ]
        search.tell(list(zip(asked, least, strict=True)))
        print(f"generation {generation}: mean of the least {np.mean(least):+.4f} m", flush=True)
    return first, search.mean


def endure(walker: Walker, steps: int) -> None:
    """Print the memory held and how long a step takes, fifth by fifth of a hostile loop."""
    rng = np.random.default_rng([SEED, FRESH])
    boxes = boxes_of(rng)
    door = VelocityFilter(walker, boxes, period=LONGEST, max_age=MAX_AGE)
    plan, robot = hostile(boxes, walker.command, rng), Moving(walker, np.zeros(3))
    ticks = round(LONGEST / CONTROL_DT)
    spent = np.zeros(steps // 5)
    for fifth in range(5):
        for k in range(len(spent)):
            now = LONGEST * (fifth * len(spent) + k)
            began = time.perf_counter()
            door.step(plan(robot.pose), robot.pose, robot.twist, now, now)
            spent[k] = time.perf_counter() - began
            for tick in range(ticks):
                robot.go(door.command_at(now + CONTROL_DT * tick))
        held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        median, most = 1e3 * np.quantile(spent, (0.5, 0.99))
        print(
            f"after {(fifth + 1) * len(spent)} steps: {held:.1f} MB, a step with its planner "
            f"{median:.3f} ms, 99 % {most:.3f} ms, fallen {robot.fallen}",
            flush=True,
        )


def main(
    robot: str = "cart",
    generations: int = 20,
    scenes: int = 2,
    count: int = 100,
    steps: int = 100_000,
) -> None:
    """Train, drive fresh scenes, and endure.

    Args:
        robot: a contract's path or name.
        generations: of 16 planners each.
        scenes: that each planner of a generation meets.
        count: fresh scenes.
        steps: of the long loop; 0 leaves it out.
    """
    warnings.simplefilter("ignore")
    walker = Walker.load(robot)
    first, last = train(walker, generations, scenes)
    for name, parameters in (("straight at it", first), ("trained", last)):
        runs = [attacked(parameters, walker, FRESH + seed) for seed in range(count)]
        least = [run.least for run in runs]
        print(
            f"{robot}: {name}: {sum(one < 0.0 for one in least)} of {count} entered, least "
            f"{min(least):+.4f} m, mean {np.mean(least):+.4f} m, {sum(r.fell for r in runs)} fell, "
            f"alarms {[run.alarms for run in runs if run.alarms]}, "
            f"statuses {sum(run.statuses for run in runs)}",
            flush=True,
        )
    if steps:
        endure(walker, steps)


if __name__ == "__main__":
    tyro.cli(main)
