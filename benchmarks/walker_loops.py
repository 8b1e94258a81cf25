"""How a walker follows, and how fast it runs: its bare loop, and the environment under a filter."""

import functools
import math
import os
import time
from collections.abc import Mapping
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np

from benchmarks.common import quietly, table
from hcbf_gym import wrappers
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation.attacked import policy_of
from hcbf_gym.evaluation.tables import Table
from hcbf_robots.envs.walker_drive import WalkerDrive
from hcbf_robots.envs.walker_physics import WalkerPhysics
from hcbf_robots.identification.identify import identify
from hcbf_robots.walkers.walker import Walker
from hcbf_robots.walkers.walker_adapter import Adapter

SEED = 77
"""Of the commands; none of those with which the responses beside the contracts were measured."""
SECONDS = 1.0
"""Of a turn of a loop [s]; loops alternate, and the fastest turn counts."""
COUNT = 16  # robots in a vector environment


def tracking(contracts: Mapping[str, str], seconds: float) -> Table:
    """Return how robots follow steps, turns and stops, for so many seconds of commands."""
    rows = [
        {"robot": name, "r": identify(Walker.load(contract), seconds, SEED).response}
        for name, contract in contracts.items()
    ]
    columns = {
        "robot": "{robot}",
        "gains": lambda row: ", ".join(f"{gain:.2f}" for gain in row["r"].gain),
        "time constant [s]": "{r.time_constant:.3f}", "delay [s]": "{r.delay:.2f}",
        "residual 95 % [m/s]": "{r.residual[1]:.3f}",
        "residual 99.9 % [m/s]": "{r.residual[2]:.3f}", "overshoot [m/s]": "{r.overshoot:.3f}",
        "rise [s]": "{r.rise:.2f}", "stops within [m]": "{r.stopping:.3f}",
        "brakes [m/s²]": "{r.braking:.2f}", "falls": "{r.falls}",
    }  # fmt: skip
    return table(f"velocity steps, turns and stops, {seconds:g} s of commands", rows, columns)


def speeds(contracts: Mapping[str, str], turns: int) -> Table:
    """Return how many times faster than real time robots run, bare and filtered, on this core."""
    rows = []
    for name, contract in contracts.items():
        bare, filtered = _Bare(contract), _Filtered(contract)
        for loop in (bare, filtered):
            loop.run(1.0)
        taken = [(bare.run(SECONDS), filtered.run(SECONDS)) for _ in range(turns)]
        one, other = (SECONDS / min(turn) for turn in zip(*taken, strict=True))
        rows.append({"robot": name, "one": one, "other": other, "share": other / one})
    columns = {"robot": "{robot}", "bare loop [× real time]": "{one:.0f}",
               "filtered, with infos": "{other:.0f}", "share of it": "{share:.2f}"}  # fmt: skip
    return table("policy, physics, filter and infos on one core", rows, columns)


def many(contract: str, count: int, seconds: float = 2.0) -> Table:
    """Return how fast filtered robots run in Gymnasium's vector environments."""
    make = functools.partial(_make, contract)
    loops: dict[str, gym.vector.VectorEnv] = {
        "one alone": gym.vector.SyncVectorEnv([make]),
        f"{COUNT} in SyncVectorEnv": gym.vector.SyncVectorEnv([make] * COUNT),
        f"{COUNT} in AsyncVectorEnv": gym.vector.AsyncVectorEnv([make] * COUNT),
    }
    for envs in loops.values():
        envs.reset(seed=0)
        _run(envs, seconds)
    turns = [[_run(envs, seconds) for envs in loops.values()] for _ in range(count)]
    speeds = [max(turn) for turn in zip(*turns, strict=True)]
    for envs in loops.values():
        envs.close()
    rows = [
        {"robots": name, "speed": speed, "one": speed / speeds[0], "sync": speed / speeds[1]}
        for name, speed in zip(loops, speeds, strict=True)
    ]
    columns = {"robots": "{robots}", "together [× real time]": "{speed:.0f}",
               "of one alone": "{one:.2f}", f"of {COUNT} on one core": "{sync:.2f}"}  # fmt: skip
    title = f"{Path(contract).stem}: many on {os.cpu_count()} cores, filter and infos included"
    return table(title, rows, columns)


def _run(envs: gym.vector.VectorEnv, seconds: float) -> float:
    """Return how many times faster than real time all robots run together."""
    u, steps = np.zeros((envs.num_envs, 2)), round(seconds / CONTROL_DT)
    start = time.perf_counter()
    for _ in range(steps):
        envs.step(u)
    return envs.num_envs * seconds / (time.perf_counter() - start)


def _make(contract: str) -> gym.Env:
    """Return a filtered robot whose episodes do not end by time."""
    options = {"robot": contract, "scenario": "random", "max_episode_steps": 10**6}
    env_id = "hcbf_robots:HCBF-WalkerRegions-v0"
    env = quietly(gym.make, env_id, disable_env_checker=True, **options)
    return quietly(wrappers.SafetyFilter, env)


class _Bare:
    """The robot's controller and physics, and nothing else."""

    def __init__(self, contract: str):
        walker = Walker.load(contract)
        self._physics = WalkerPhysics(walker)
        adapter = Adapter(walker.command, walker.response, math.inf, walker.period)
        self._drive = WalkerDrive(self._physics, adapter, None)
        self._drive.reset(np.zeros(2), 0.0, BarrierSet([()]), np.random.default_rng(0))
        self._ticks = round(walker.period / self._physics.model.opt.timestep)
        self._period = walker.period

    def run(self, seconds: float) -> float:
        """Return how long so many seconds take [s]."""
        model, data, drive = self._physics.model, self._physics.data, self._drive
        start = time.perf_counter()
        for _ in range(round(seconds / self._period)):
            drive.command[0] = 0.5
            drive.act()
            data.ctrl[:] = drive.ctrl
            for _ in range(self._ticks):
                mujoco.mj_step(model, data)
        return time.perf_counter() - start


class _Filtered:
    """The environment under a filter and an attack."""

    def __init__(self, contract: str):
        self._env, self._seed = _make(contract), 0

    def run(self, seconds: float) -> float:
        """Return how long so many seconds take [s], the attack not counted."""
        env, taken = self._env, 0.0
        self._seed += 1
        observation, info = env.reset(seed=self._seed)
        wanted = policy_of("rotating", env, self._seed)
        for _ in range(round(seconds / CONTROL_DT)):
            u = wanted(observation, info)
            start = time.perf_counter()
            observation, _, ended, _, info = env.step(u)
            taken += time.perf_counter() - start
            if ended:
                observation, info = env.reset()
        return taken
