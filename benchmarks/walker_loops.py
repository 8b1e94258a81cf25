"""How a walker follows, and how fast it runs: its bare loop, and the environment under a filter."""

import functools
import math
import os
import time
import warnings
from collections.abc import Mapping
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np

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
ROUNDS, SECONDS = 40, 1.0
"""Turns of each loop, and how long they are [s]; taken in alternation, the fastest counts."""


def tracking(contracts: Mapping[str, str], seconds: float = 60.0) -> Table:
    """Return how robots follow steps, turns and stops.

    Args:
        contracts: name → a contract's path or name.
        seconds: of random commands [s].
    """
    header = (
        "robot", "gains", "time constant [s]", "delay [s]", "residual 95 % [m/s]",
        "residual 99.9 % [m/s]", "overshoot [m/s]", "rise [s]", "stops within [m]",
        "brakes [m/s²]", "falls",
    )  # fmt: skip
    rows = []
    for name, contract in contracts.items():
        r = identify(Walker.load(contract), seconds, SEED).response
        rows.append(
            [
                name,
                ", ".join(f"{gain:.2f}" for gain in r.gain),
                f"{r.time_constant:.3f}",
                f"{r.delay:.2f}",
                f"{r.residual[1]:.3f}",
                f"{r.residual[2]:.3f}",
                f"{r.overshoot:.3f}",
                f"{r.rise:.2f}",
                f"{r.stopping:.3f}",
                f"{r.braking:.2f}",
                str(r.falls),
            ]
        )
    return Table(f"velocity steps, turns and stops, {seconds:g} s of commands", header, rows)


def speeds(contracts: Mapping[str, str]) -> Table:
    """Return how many times faster than real time robots run, bare and filtered, on this core.

    Args:
        contracts: name → a contract's path or name.
    """
    rows = []
    for name, contract in contracts.items():
        bare, filtered = _Bare(contract), _Filtered(contract)
        for loop in (bare, filtered):
            loop.run(1.0)
        taken = [(bare.run(SECONDS), filtered.run(SECONDS)) for _ in range(ROUNDS)]
        one, other = (SECONDS / min(turn) for turn in zip(*taken, strict=True))
        rows.append([name, f"{one:.0f}", f"{other:.0f}", f"{other / one:.2f}"])
    header = ("robot", "bare loop [× real time]", "filtered, with infos", "share of it")
    return Table("policy, physics, filter and infos on one core", header, rows)


def many(contract: str, count: int = 16, seconds: float = 2.0) -> Table:
    """Return how fast filtered robots run in Gymnasium's vector environments.

    Args:
        contract: a path or a name.
        count: of the robots.
        seconds: of every turn [s].
    """
    make = functools.partial(_make, contract)
    loops: dict[str, gym.vector.VectorEnv] = {
        "one alone": gym.vector.SyncVectorEnv([make]),
        f"{count} in SyncVectorEnv": gym.vector.SyncVectorEnv([make] * count),
        f"{count} in AsyncVectorEnv": gym.vector.AsyncVectorEnv([make] * count),
    }
    for envs in loops.values():
        envs.reset(seed=0)
        _run(envs, seconds)
    turns = [[_run(envs, seconds) for envs in loops.values()] for _ in range(ROUNDS // 4)]
    speeds = [max(turn) for turn in zip(*turns, strict=True)]
    for envs in loops.values():
        envs.close()
    header = ("robots", "together [× real time]", "of one alone", f"of {count} on one core")
    rows = [
        [name, f"{speed:.0f}", f"{speed / speeds[0]:.2f}", f"{speed / speeds[1]:.2f}"]
        for name, speed in zip(loops, speeds, strict=True)
    ]
    title = f"{Path(contract).stem}: many on {os.cpu_count()} cores, filter and infos included"
    return Table(title, header, rows)


def _run(envs: gym.vector.VectorEnv, seconds: float) -> float:
    """Return how many times faster than real time all robots run together."""
    u, steps = np.zeros((envs.num_envs, 2)), round(seconds / CONTROL_DT)
    start = time.perf_counter()
    for _ in range(steps):
        envs.step(u)
    return envs.num_envs * seconds / (time.perf_counter() - start)


def _make(contract: str) -> gym.Env:
    """Return a filtered robot whose episodes do not end by time."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = gym.make(
            "HCBF-WalkerRegions-v0",
            robot=contract,
            scenario="random",
            max_episode_steps=10**6,
            disable_env_checker=True,
        )
        return wrappers.SafetyFilter(env)


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
        self._env = _make(contract)
        self._seed = 0

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
