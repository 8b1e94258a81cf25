"""Environment steps per second of one core, beside Gymnasium's own ways and Ant-v5.

The seconds are the process's own (CPU time of one thread), so that a busy machine does not count.
"""

import time
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import SyncVectorEnv

import hcbf_gym
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
    rows = [
        _row("native", N, scenario, program, native(scenario, program, N), steps)
        for scenario in (FIVE_ROWS, "random")
        for program in ("none", "r-cbf-qp", "h-cbf-qp", "eh-cbf-qp", "lex-cbf-qp")
    ]
    rows += [
        _row(kind, n, FIVE_ROWS, program, make(FIVE_ROWS, program, n), steps)
        for program in ("none", "lex-cbf-qp")
        for kind, n, make in (("native", 1, native), ("SyncVectorEnv", 16, sync))
    ]
    rows += [
        _row(
            "native",
            N,
            scenario,
            "lex-cbf-qp",
            native(scenario, "lex-cbf-qp", N, kind),
            steps,
            kind,
        )
        for scenario in (FIVE_ROWS, "random")
        for kind in ("geodesic", "local")
    ]
    ant = SyncVectorEnv([lambda: gym.make("Ant-v5")] * 16)
    rows.append(_row("SyncVectorEnv of Ant-v5", 16, "-", "-", ant, steps))
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
    kind: str,
    n: int,
    scenario: str | Scenario,
    program: str,
    env: gym.vector.VectorEnv,
    steps: int,
    guidance: str | None = None,
) -> dict[str, Any]:
    target = TARGETS.get((kind, program)) if n == N and scenario is FIVE_ROWS else None
    target = None if guidance else target
    return {
        "environment": kind,
        "n": n,
        "scenario": scenario if isinstance(scenario, str) else scenario.name,
        "program": program,
        "guidance": guidance,
        "steps_per_second": steps_per_second(env, steps),
        "target": target,
    }


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return steps per second of each combination, beside what is asked."""
    cells = [
        (
            row["environment"],
            str(row["n"]),
            row["scenario"],
            row["program"],
            row["guidance"] or "",
            f"{row['steps_per_second']:,.0f}",
            "" if row["target"] is None else f"{row['target']:,.0f}",
        )
        for row in figures["rows"]
    ]
    header = ("environment", "N", "scene", "program", "guidance", "steps/s", "asked")
    return {"all": Table("Environment steps per second of one core", header, cells)}
