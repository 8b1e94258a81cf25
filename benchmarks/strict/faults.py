"""What the filter notices of what a careless user puts between it and the robot."""

from collections import deque
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import joblib
import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.evaluation.attacked import AttackedEpisode
from hcbf_gym.evaluation.tables import Table

POLICIES = ("pd", "nearest", "bang-bang", "edge")
SECONDS = 8.0


class Delayed(gym.ActionWrapper):
    """Applies every action ten steps late."""

    def __init__(self, env: gym.Env):
        super().__init__(env)
        self._waiting: deque[Array] = deque()

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Start with ten steps of rest on the way."""
        self._waiting = deque(np.zeros((10, 2)))
        return self.env.reset(**options)

    def action(self, action: Array) -> Array:
        """Return what was chosen ten steps ago."""
        self._waiting.append(np.array(action))
        return self._waiting.popleft()


class Held(gym.ActionWrapper):
    """Takes a new action at every 25th step alone."""

    def __init__(self, env: gym.Env):
        super().__init__(env)
        self._steps, self._last = 0, np.zeros(2)

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Start the count."""
        self._steps = 0
        return self.env.reset(**options)

    def action(self, action: Array) -> Array:
        """Return the action that was taken last."""
        if self._steps % 25 == 0:
            self._last = np.array(action)
        self._steps += 1
        return self._last


class Doubled(gym.ActionWrapper):
    """Applies twice the action."""

    def action(self, action: Array) -> Array:
        """Return twice the action."""
        return 2.0 * np.asarray(action)


FAULTS: dict[str, Callable[[gym.Env], gym.Env] | None] = {  # What stands between filter and robot
    "none": None,
    "delay of 10 steps": Delayed,
    "hold of 25 steps": Held,
    "gain of 2": Doubled,
}


def run(quick: bool) -> dict[str, Any]:
    """Count the episodes in which the filter warned, on the reduced-order model and on the A1."""
    rows = []
    for env, count in (("HCBF-Regions-v0", 200), ("HCBF-A1Regions-v0", 100)):
        for fault in FAULTS:
            episodes = [_episode(env, fault, k) for k in range(2 if quick else count)]
            outcomes = joblib.Parallel(n_jobs=-1)(joblib.delayed(e.run)() for e in episodes)
            warned = sum(outcome.warned for outcome in outcomes if outcome is not None)
            rows.append({"env": env, "fault": fault, "episodes": len(episodes), "warned": warned})
    return {"monitor": rows}


def _episode(env: str, fault: str, k: int) -> AttackedEpisode:
    return AttackedEpisode(
        POLICIES[k % len(POLICIES)],
        "random",
        70_000 + k,
        env=env,
        env_options={"max_episode_steps": round(SECONDS / 0.02)},
        inside=FAULTS[fault],
    )


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return how often the filter warned."""
    rows = [
        (row["env"], row["fault"], str(row["episodes"]), str(row["warned"]))
        for row in figures["monitor"]
    ]
    header = ("environment", "between filter and robot", "episodes", "warned")
    return {"warnings": Table("does the filter notice?", header, rows)}
