"""Environment steps per second of one core, beside Gymnasium's vector environments and Ant-v5.

The seconds are the process's own (CPU time of one thread), so that a busy machine does not count.
"""

import time
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import SyncVectorEnv

import hcbf_gym
from benchmarks.common import table
from hcbf_gym import scenarios, wrappers
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.scenarios import Scenario

FIVE_ROWS = replace(scenarios.make("paper-four-levels"), name="four levels, speed limit", v_max=1.2)
"""m = 5: the paper's four barriers at four priorities, and a speed limit."""

TARGETS = {("native", "none"): 1_000_000, ("native", "lex-cbf-qp"): 200_000}
"""Steps per second that the batch of 4096 must reach with five rows."""

N = 4096
EPISODE = 100  # Steps of an episode, few enough for every episode to restart during the measurement


def run(quick: bool) -> dict[str, Any]:
    """Measure and return steps per second of each combination."""
    steps = EPISODE + 10 if quick else 3 * EPISODE
    every = ("none", "r-cbf-qp", "h-cbf-qp", "eh-cbf-qp", "lex-cbf-qp")
    cases = [("native", N, scene, name, None) for scene in (FIVE_ROWS, "random") for name in every]
    for name in ("none", "lex-cbf-qp"):
        cases += [
            ("native", 1, FIVE_ROWS, name, None),
            ("SyncVectorEnv", 16, FIVE_ROWS, name, None),
        ]
    for scene in (FIVE_ROWS, "random"):
        cases += [("native", N, scene, "lex-cbf-qp", kind) for kind in ("geodesic", "local")]
    rows = [_row(*case, steps) for case in cases]
    ant = SyncVectorEnv([lambda: gym.make("Ant-v5")] * 16)
    rows.append(
        {"environment": "SyncVectorEnv of Ant-v5", "n": 16, "scenario": "-", "program": "-"}
        | {"guidance": None, "target": None, "steps_per_second": steps_per_second(ant, steps)}
    )
    return {"rows": rows, "hcbf_gym": hcbf_gym.__version__, "gymnasium": gym.__version__}


def native(
    scenario: str | Scenario, program: str, n: int, guidance: str | None = None
) -> gym.vector.VectorEnv:
    """Return the native batch of n environments."""
    env = gym.make_vec("HCBF-Regions-v0", num_envs=n, scenario=scenario, max_episode_steps=EPISODE)
    if program == "none":
        return env
    return wrappers.VectorSafetyFilter(env, program=program, guidance=guidance)


def sync(scenario: str | Scenario, program: str, n: int) -> gym.vector.VectorEnv:
    """Return n single environments, stepped one after the other."""

    def make() -> gym.Env:
        env = gym.make("HCBF-Regions-v0", scenario=scenario, max_episode_steps=EPISODE)
        return env if program == "none" else wrappers.SafetyFilter(env, program=program)

    return SyncVectorEnv([make] * n)


def steps_per_second(env: gym.vector.VectorEnv, steps: int) -> float:
    """Return environment steps per second under uniform random actions, restarts included."""
    space: Any = env.single_action_space
    rng = np.random.default_rng(0)
    actions = rng.uniform(space.low, space.high, (8, env.num_envs, *space.shape))
    actions = actions.astype(space.dtype)
    env.reset(seed=0)
    for action in actions[:5]:
        env.step(action)
    begin = time.process_time()
    for i in range(steps):
        env.step(actions[i % len(actions)])
    seconds = time.process_time() - begin
    env.close()
    return env.num_envs * steps / seconds


def _row(
    kind: str, n: int, scenario: str | Scenario, program: str, guidance: str | None, steps: int
) -> dict[str, Any]:
    own = kind == "native"
    env = native(scenario, program, n, guidance) if own else sync(scenario, program, n)
    required = n == N and scenario is FIVE_ROWS and not guidance
    return {
        "environment": kind, "n": n,
        "scenario": scenario if isinstance(scenario, str) else scenario.name,
        "program": program, "guidance": guidance,
        "steps_per_second": steps_per_second(env, steps),
        "target": TARGETS.get((kind, program)) if required else None,
    }  # fmt: skip


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return steps per second of each combination, beside the requirement."""
    columns = {
        "environment": "{environment}", "N": "{n}", "scene": "{scenario}", "program": "{program}",
        "guidance": lambda row: row["guidance"] or "", "steps/s": "{steps_per_second:,.0f}",
        "asked": lambda row: "" if row["target"] is None else f"{row['target']:,.0f}",
    }  # fmt: skip
    return {"all": table("Environment steps per second of one core", figures["rows"], columns)}
