"""Where the time goes that `SafetyFilter` adds to a step: each part alone, in its own loop.

Inside a user's loop every part takes longer, since the environment has filled the caches with other
things in between; `benchmarks.suites.filter` has that sum.
"""

import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.common import median
from hcbf_gym.arrays import numbers_of
from hcbf_gym.barriers import Disc
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.plant import Estimate, Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator
from hcbf_gym.wrappers import SafetyFilter

PERIOD, ROUNDS, CALLS = 0.02, 200, 20


class _Still(gym.Env[Any, Any]):
    """A plant at rest, far from everything."""

    action_space = gym.spaces.Box(-5.0, 5.0, (2,), dtype=np.float64)
    observation_space = gym.spaces.Box(-np.inf, np.inf, (4,), dtype=np.float64)

    def __init__(self) -> None:
        self.x, self.time = np.zeros(4), 0.0

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        self.time = 0.0
        return self.x, {}

    def step(self, action: Any) -> Any:
        self.time += PERIOD
        return self.x, 0.0, False, False, {}


def shares() -> list[dict[str, Any]]:
    """Return the parts of a filtered step of a plant with a list of five discs, and their µs."""
    discs = [Disc(f"{k}", 1 + k % 3, (30.0, 10.0 * k), 1.0) for k in range(5)]
    plant = Plant(
        DoubleIntegrator(),
        discs,
        lambda env, observation, info: Estimate(env.x, env.time),
        Box.symmetric(5.0),
        period=PERIOD,
    )
    bare, env = _Still(), SafetyFilter(_Still(), plant=plant)
    env.reset()
    u = np.zeros(2)
    whole = _time(lambda: env.step(u)) - _time(lambda: bare.step(u))
    core: Any = env._core
    samples, buffer = core.samples, core._bound
    whole_report = buffer.words
    refused = buffer.plants.copy()
    refused["u_nominal"] = np.nan
    compiled = buffer.core

    barriers, x = env._read("barriers", "state")
    estimate = x if isinstance(x, Estimate) else Estimate(x)

    def call() -> None:
        samples.time[0] += PERIOD
        compiled.filter()

    def refuse() -> Callable[[], None]:
        compiled.set_report(numbers_of(refused), whole_report[1])
        return call

    def accept() -> Callable[[], None]:
        compiled.set_report(*whole_report)
        return call

    def later() -> None:
        samples.time[0] += PERIOD

    times = {
        "the action, as an array of numbers": _time(lambda: u.astype(np.float64)),
        "the plant's readers": _time(lambda: env._read("barriers", "state")),
        "taking the estimate": _time(lambda: samples.take(estimate)),
        "taking the barriers": _time(lambda: core.scenes.take(barriers, estimate, None)),
        "crossing into compiled code": (crossing := _time(refuse())) - _time(later),
        "margins, rows, program, monitor": _time(accept()) - crossing,
        "the report": _time(buffer.report),
    }
    times |= {"the calls between these": whole - sum(times.values()), "all": whole}
    return [{"part": name, "time": value} for name, value in times.items()]


def _time(call: Callable[[], Any]) -> float:
    """Return a call's median time [µs]."""
    return median(lambda: [call() for _ in range(CALLS)], ROUNDS, time.perf_counter) / CALLS
