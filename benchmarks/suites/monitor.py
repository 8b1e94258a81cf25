"""Whether the filter warns of wrappers between itself and the robot."""

from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.common import parallel, table
from hcbf_gym.evaluation.attacked import AttackedEpisode
from hcbf_gym.evaluation.tables import Table

EPISODES = {"HCBF-Regions-v0": 200, "HCBF-A1Regions-v0": 100}
POLICIES = ("pd", "nearest", "bang-bang", "edge")
FIRST_SEED = 70_000


class Between(gym.ActionWrapper):
    """A wrapper of a careless user: from all actions of an episode it makes the present one."""

    def __init__(self, env: gym.Env, change: Callable[[list[Any]], Any]):
        super().__init__(env)
        self._change, self._past = change, []

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Begin with no action."""
        self._past = []
        return self.env.reset(**options)

    def action(self, action: Any) -> Any:
        """Return what is applied in its place."""
        self._past.append(np.array(action))
        return self._change(self._past)


WRAPPERS: dict[str, Callable[[gym.Env], gym.Env] | None] = {
    "none": None,
    "delay of 10 steps": partial(Between, change=lambda u: u[-11] if len(u) > 10 else np.zeros(2)),
    "hold of 25 steps": partial(Between, change=lambda u: u[(len(u) - 1) // 25 * 25]),
    "gain of 2": partial(Between, change=lambda u: 2.0 * u[-1]),
}
"""What is between filter and robot."""


def run(quick: bool) -> dict[str, Any]:
    """Count the episodes with a warning, on the reduced-order model and the A1."""
    rows = []
    for env, count in EPISODES.items():
        for fault, wrapper in WRAPPERS.items():
            episodes = [
                AttackedEpisode(
                    POLICIES[k % 4], "random", FIRST_SEED + k, env,
                    {"max_episode_steps": 400}, inside=wrapper,
                )
                for k in range(2 if quick else count)
            ]  # fmt: skip
            seen = parallel(AttackedEpisode.run, ((one,) for one in episodes))
            warned = sum(outcome.warned for outcome in seen)
            rows.append({"env": env, "fault": fault, "episodes": len(episodes), "warned": warned})
    return {"monitor": rows}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return how often the filter warned."""
    columns = {"environment": "{env}", "between filter and robot": "{fault}",
               "episodes": "{episodes}", "warned": "{warned}"}  # fmt: skip
    return {"warnings": table("does the filter notice?", figures["monitor"], columns)}
