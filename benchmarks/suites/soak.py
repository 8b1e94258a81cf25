"""An hour of simulated time with resets and faults: whether the memory stays flat."""

import contextlib
import copy
import functools
import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.common import parallel, table
from benchmarks.suites.monitor import WRAPPERS
from hcbf_gym import wrappers
from hcbf_gym.errors import HcbfError
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.programs import FilterStatus

SECONDS = 3600.0  # Of simulated time, for the A1, and for every copy of the reduced-order model
EPISODES_PER_ENV = 8
"""Then the A1's environment is closed, and one with another fault inside is made."""
COPIES = 8
DT = 0.02

CONDITIONS: dict[str, Any] = {  # Of the A1's plant; the hardest pushes make it fall
    "randomization": {
        "floor_friction": [0.4, 0.8],
        "payload": [0.0, 4.0],
        "motor_strength": [0.8, 1.0],
        "delay": [0.002, 0.008],
        "sensor_noise": [0.0, 1.0],
        "start_yaw": [0.0, 3.0],
    },
    "disturbances": {"kind": "random", "interval": 3.0, "impulse": [5.0, 60.0]},
    "estimation": {},
}

BAD_ACTIONS: tuple[Any, ...] = (np.full(2, np.nan), np.zeros(3), "ab", {}, None, [1j, 0.0])


def run(quick: bool) -> dict[str, Any]:
    """Let both environments run, each in a process, and return the memory that it held."""
    seconds = SECONDS / 60.0 if quick else SECONDS
    on_robot, on_model = parallel(_walk, ((walk, seconds) for walk in (a1, native)), workers=2)
    return {
        "seconds": seconds,
        "soak": [
            {"what": "A1"} | _summary(*on_robot),
            {"what": f"reduced order, {COPIES} at once"} | _summary(*on_model),
        ],
    }


def _walk(walk: Callable[[float], Any], seconds: float) -> Any:
    return walk(seconds)


def a1(seconds: float) -> tuple[list[float], dict[str, int]]:
    """Run A1 episodes back to back; return the memory after each [MB], and what happened."""
    rng = np.random.default_rng(0)
    memory: list[float] = []
    seen = {"episodes": 0, "falls": 0, "qp_failures": 0, "BACKUP": 0, "refused": 0}
    left = seconds
    while left > 0.0:
        fault = list(WRAPPERS.values())[(len(memory) // EPISODES_PER_ENV) % len(WRAPPERS)]
        inner = gym.make("HCBF-A1Regions-v0", scenario="random-moving", **CONDITIONS)
        inside = inner if fault is None else fault(inner)
        env = wrappers.SafetyFilter(inside, program="lex-cbf-qp", guidance="geodesic")
        for _ in range(EPISODES_PER_ENV):
            left -= _episode(env, rng, left, seen)
            memory.append(resident())
            if left <= 0.0:
                break
        env.close()
    return memory, seen


def _episode(env: gym.Env, rng: np.random.Generator, left: float, seen: dict[str, int]) -> float:
    """Run one episode under a random policy, with bad input; return its time [s]."""
    inner: Any = env.unwrapped
    env.reset(seed=int(rng.integers(2**31)))  # Gymnasium's checker requires one before a bad one
    seen["refused"] += _refused(lambda: env.reset(options={"no such option": 1}))
    env.reset()
    ended, u, info = False, np.zeros(2), {}
    while not ended and inner.time < left:
        if rng.random() < 0.05:
            u = rng.uniform(-5.0, 5.0, 2)
        if rng.random() < 0.01:
            action = BAD_ACTIONS[rng.integers(len(BAD_ACTIONS))]
            bad = functools.partial(env.step, action), functools.partial(copy.deepcopy, inner)
            seen["refused"] += sum(map(_refused, bad))
        _, _, terminated, truncated, info = env.step(u)
        seen["BACKUP"] += int(info["safety_filter"]["status"] == FilterStatus.BACKUP)
        ended = terminated or truncated
    seen["episodes"] += 1
    seen["falls"] += int(info.get("fallen", 0.0))
    seen["qp_failures"] += int(info.get("qp_failures", 0.0))
    return float(inner.time)


def _refused(attempt: Callable[[], object]) -> int:
    """Return 1 where bad input was refused: an action, an option, a copy; else 0."""
    with contextlib.suppress(HcbfError):
        attempt()
        return 0
    return 1


def native(seconds: float) -> tuple[list[float], dict[str, int]]:
    """Step the native vector environment; return the memory after every 20 s of it [MB]."""
    rng = np.random.default_rng(0)
    env: Any = gym.make_vec("HCBF-Regions-v0", num_envs=COPIES, scenario="random-moving")
    env = wrappers.VectorSafetyFilter(env, program="lex-cbf-qp", guidance="geodesic")
    env.reset(seed=0)
    memory: list[float] = []
    seen = {"episodes": COPIES, "falls": 0, "qp_failures": 0, "BACKUP": 0, "refused": 0}
    for step in range(round(seconds / DT)):
        _, _, terminated, truncated, info = env.step(rng.uniform(-5.0, 5.0, (COPIES, 2)))
        seen["episodes"] += int((terminated | truncated).sum())
        seen["BACKUP"] += int((info["safety_filter"]["status"] == FilterStatus.BACKUP).sum())
        if step % 1000 == 999:
            with contextlib.suppress(HcbfError):
                env.step(np.full((COPIES, 2), np.nan))
                seen["refused"] -= 1
            seen["refused"] += 1
            memory.append(resident())
        if step % 5000 == 4999:
            env.reset(seed=step)
    env.close()
    return memory, seen


def resident() -> float:
    """Return the memory that this process holds [MB]; its peak where the system has no more."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return pages * resource.getpagesize() / 2**20


def _summary(memory: list[float], seen: dict[str, int]) -> dict[str, Any]:
    """Return the memory after a tenth, half and all of the time, and its greatest value."""
    at = [memory[round(share * (len(memory) - 1))] for share in (0.1, 0.5, 1.0)]
    return {"memory": at, "largest": max(memory), "samples": memory, **seen}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the table of memory and of what happened meanwhile."""
    columns = {
        "": "{what}", "episodes": "{episodes}", "after 10 % [MB]": "{memory[0]:.1f}",
        "50 %": "{memory[1]:.1f}", "100 %": "{memory[2]:.1f}", "largest": "{largest:.1f}",
        "falls": "{falls}", "BACKUP steps": "{BACKUP}", "QP failures": "{qp_failures}",
        "bad input refused": "{refused}",
    }  # fmt: skip
    title = f"{figures['seconds']:.0f} s of simulated time, with resets and faults"
    return {"memory": table(title, figures["soak"], columns)}
