"""One version of the package in a process of its own: it says how long its steps take.

It stands alone and uses only what every version since 0.1 offers, so that an older checkout on
PYTHONPATH can run it, too. Each line of input is a case in JSON; each line of output is the
processor time of one step [s], or of one state of a batch, over a block of the case's steps.
"""

import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import SyncVectorEnv

from hcbf_gym import programs, scenarios, wrappers

EPISODE = 100


def block(case: dict[str, Any]) -> Callable[[], float]:
    """Return a function that runs one block of a case and returns the seconds of a step."""
    if case["what"] == "batch":
        return _batch(case)
    env = _environment(case)
    env.reset(seed=0)
    many = isinstance(env, gym.vector.VectorEnv)
    count = env.num_envs if isinstance(env, gym.vector.VectorEnv) else 1
    space: Any = env.single_action_space if isinstance(env, gym.vector.VectorEnv) else None
    space = env.action_space if space is None else space
    rng = np.random.default_rng(0)
    shape = (64, count, 2) if many else (64, 2)
    actions = rng.uniform(space.low, space.high, shape).astype(space.dtype)

    def run() -> float:
        begin = time.process_time()
        for i in range(case["steps"]):
            _, _, terminated, truncated, _ = env.step(actions[i % 64])
            if not many and (terminated or truncated):
                env.reset()
        return (time.process_time() - begin) / (case["steps"] * count)

    return run


def _environment(case: dict[str, Any]) -> Any:
    scene, program, kind = _scenario(case["scenario"]), case["program"], case["what"]
    name = "HCBF-A1Regions-v0" if kind == "A1" else "HCBF-Regions-v0"
    options: dict[str, Any] = {"scenario": scene, "max_episode_steps": EPISODE}
    if kind == "native":
        env = gym.make_vec(name, num_envs=case["n"], **options)
        return env if program == "none" else wrappers.VectorSafetyFilter(env, program=program)

    def make() -> gym.Env:
        env = gym.make(name, **options)
        return env if program == "none" else wrappers.SafetyFilter(env, program=program)

    return SyncVectorEnv([make] * case["n"]) if kind == "Sync" else make()


def _scenario(name: Any) -> Any:
    """Return a scenario; "five rows" has the paper's four barriers and a speed limit."""
    if name == "five rows":
        return replace(scenarios.make("paper-four-levels"), name=name, v_max=1.2)
    return name


def _batch(case: dict[str, Any]) -> Callable[[], float]:
    """Return calls of a batch program on random rows of four priorities, half of them active."""
    n, rng = case["n"], np.random.default_rng(0)
    a, b = rng.normal(0.0, 1.0, (n, 4, 2)), rng.normal(0.0, 2.0, (n, 4))
    psi, priority = rng.normal(0.0, 1.0, (n, 4)), np.tile([1, 2, 3, 4], (n, 1))
    rows = programs.CbfRows(a, b, psi, priority, 2.0 * psi)
    u, batch = rng.normal(0.0, 3.0, (n, 2)), programs.make_batch(case["program"])

    def run() -> float:
        begin = time.process_time()
        for _ in range(case["steps"]):
            batch(u, rows)
        return (time.process_time() - begin) / (case["steps"] * n)

    return run


def main() -> None:
    """Answer each case on standard input; a case that was seen before goes on."""
    blocks: dict[str, Callable[[], float]] = {}
    for line in sys.stdin:
        if line not in blocks:
            blocks[line] = block(json.loads(line))
            blocks[line]()  # the first block compiles and warms up
        print(blocks[line](), flush=True)


if __name__ == "__main__":
    main()
