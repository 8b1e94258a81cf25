"""How fast batches of a user's own are filtered: ``python -m benchmarks.batch_speed``.

N double integrators with a scene each, through `BatchFilter` on one core and on two, and through
`VectorSafetyFilter` with a plant's readers around an environment that only integrates. The answers
of all three are compared. Measured in turn, medians, on an idle machine.
"""

import time
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from rich.console import Console

import hcbf_gym
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.barriers.scenes import scenes_of_arrays
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.models import DoubleIntegrator
from hcbf_gym.models.input_sets import Box

PERIOD, U = 0.02, Box.symmetric(5.0)
KINDS, RANKS = ["disc", "disc", "disc", "disc", "speed-limit"], [1, 2, 3, 4, 1]


@dataclass
class Args:
    """Measure.

    Args:
        plants: N.
        steps: that are measured, after as many that are not.
        seed: of the scenes.
    """

    plants: int = 4096
    steps: int = 100
    seed: int = 0


class Integrators(VectorEnv):
    """N double integrators in scenes of their own, without episodes' ends."""

    def __init__(self, x: Array, scenes: BarrierSet):
        self.num_envs, self.start, self.scenes = len(x), x, scenes
        self.metadata = {"autoreset_mode": AutoresetMode.DISABLED}
        self.single_action_space = gym.spaces.Box(-5.0, 5.0, (2,), np.float64)
        self.action_space = batch_space(self.single_action_space, len(x))
        self.never = np.zeros(len(x), dtype=np.bool_)
        self.plant = hcbf_gym.Plant(
            DoubleIntegrator(),
            lambda env, *_: env.scenes,
            lambda env, *_: env.x,
            U,
            period=PERIOD,
        )

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Array, dict[str, Any]]:
        """Stand where they begin."""
        self.x = self.start.copy()
        return self.x, {}

    def step(self, actions: Array) -> tuple[Array, Array, Mask, Mask, dict[str, Any]]:
        """Hold inputs for one period."""
        self.x = moved(self.x, actions)
        return self.x, np.zeros(len(self.x)), self.never, self.never, {}


def moved(x: Array, u: Array) -> Array:
    """Return the states after one period."""
    after = x.copy()
    after[:, :2] += PERIOD * x[:, 2:] + 0.5 * PERIOD**2 * u
    after[:, 2:] += PERIOD * u
    return after


def main(args: Args) -> None:
    """Measure, and print a table."""
    rng = np.random.default_rng(args.seed)
    x = np.zeros((args.plants, 4))
    x[:, :2], x[:, 2:] = rng.uniform(-5, 5, x[:, :2].shape), rng.uniform(-1, 1, x[:, 2:].shape)
    numbers = np.zeros((args.plants, 5, 3))
    numbers[:, :4, :2], numbers[:, :4, 2] = rng.uniform(-5, 5, (args.plants, 4, 2)), 0.5
    numbers[:, 4, 0] = 2.0
    scenes = scenes_of_arrays(KINDS, numbers, RANKS, (0.0, 0.0), args.plants)
    filters = [hcbf_gym.BatchFilter(U, PERIOD, args.plants, threads=threads) for threads in (1, 2)]
    for one in filters:
        one.set_scene(scenes)
        one.reset(x=x)
    envs = hcbf_gym.wrappers.VectorSafetyFilter(Integrators(x, scenes))
    envs.reset()
    wanted = rng.uniform(-5.0, 5.0, (args.plants, 2))
    times = np.zeros((2 * args.steps, 3))
    for k in range(2 * args.steps):
        if k % 25 == 0:
            wanted = rng.uniform(-5.0, 5.0, (args.plants, 2))
        answers: list[Array] = []
        for j, one in enumerate(filters):
            begin = time.perf_counter()
            answers.append(one(wanted, x)[0])
            times[k, j] = time.perf_counter() - begin
        begin = time.perf_counter()
        *_, info = envs.step(wanted)
        times[k, 2] = time.perf_counter() - begin
        assert np.array_equal(answers[0], answers[1])
        assert np.array_equal(answers[0], info["safety_filter"]["u_safe"])
        x = moved(x, answers[0])
    rates = args.plants / np.median(times[args.steps :], axis=0)
    names = "BatchFilter, one core", "BatchFilter, two cores", "VectorSafetyFilter, with its steps"
    rows = [
        (name, f"{1e-6 * rate:.2f}", f"{rate / rates[0]:.2f}")
        for name, rate in zip(names, rates, strict=True)
    ]
    header = ("way", "10⁶ states/s", "of one core")
    table = Table(f"{args.plants} double integrators with a scene each", header, rows)
    Console().print(table.rich())


if __name__ == "__main__":
    main(tyro.cli(Args))
