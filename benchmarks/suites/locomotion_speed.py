"""How fast the walk runs, beside MuJoCo alone in the same run.

Episodes are timed in CPU seconds of this process, which runs on one core: what other processes do
meanwhile does not count.
"""

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

import gymnasium as gym
import mujoco
import numpy as np

import hcbf_gym
from benchmarks.suites.walks import Measure
from hcbf_gym import _core
from hcbf_gym.arrays import Array
from hcbf_gym.locomotion import qp
from hcbf_gym.locomotion.controller import LocomotionController

STEPS = 1000  # of 20 ms
DT = 0.002


def speed_figures(quick: bool) -> list[Measure]:
    """Return real-time factors and the stages of a tick."""
    repetitions = 1 if quick else 5
    walking, alone = time_episodes(repetitions)
    ratio = float(np.median(alone / walking))
    figures = [
        Measure("speed", "real-time factor", real_time(walking), "×", 25.0, True),
        Measure("speed", "real-time factor of MuJoCo alone", real_time(alone), "×"),
        Measure("speed", "share of MuJoCo's own speed", ratio, "", 0.3, True),
    ]
    return [*figures, *stage_shares()]


def real_time(seconds: Array) -> float:
    """Return simulated seconds per second, median over the runs."""
    return float(np.median(STEPS * 0.02 / seconds))


def time_episodes(repetitions: int) -> tuple[Array, Array]:
    """Return (n,) seconds of an episode, and of MuJoCo alone under its torques.

    They take turns, so that a slow spell of the machine falls on all of them.
    """
    env, torques, start = recorded_episode()
    seconds = np.array(
        [(run_episode(env), replay(env, torques, start)) for _ in range(repetitions)]
    )
    env.close()
    return seconds[:, 0], seconds[:, 1]


def replay(env: gym.Env[Any, Any], torques: Array, start: Array) -> float:
    """Return the seconds that MuJoCo takes for the torques (n, 12) from the qpos `start`."""
    core: Any = env.unwrapped
    model, data = core.simulation.model, core.simulation.data
    mujoco.mj_resetData(model, data)
    data.qpos[:] = start
    ctrl = data.ctrl
    begin = time.process_time()
    for torque in torques:
        ctrl[:] = torque
        mujoco.mj_step(model, data)
    return time.process_time() - begin


def make_env() -> gym.Env[Any, Any]:
    """Return the paper's course on the A1."""
    env = gym.make("HCBF-A1Regions-v0", scenario="paper-simulation")
    core: Any = env.unwrapped
    core.drive.controller = LocomotionController(max_speed=1.2)
    return env


def recorded_episode() -> tuple[gym.Env[Any, Any], Array, Array]:
    """Return the environment after an episode, every torque of it (n, 12), and the first qpos."""
    env = make_env()
    core: Any = env.unwrapped
    simulation, torques = core.simulation, []
    step = simulation.step

    def recorded(torque: Array) -> None:
        step(torque)
        torques.append(simulation.data.ctrl.copy())

    simulation.step = recorded
    env.reset(seed=0)
    start = simulation.data.qpos.copy()
    run_episode(env)
    simulation.step = step
    return env, np.array(torques), start


def run_episode(env: gym.Env[Any, Any]) -> float:
    """Return the seconds that an episode takes under the unfiltered PD policy."""
    policy = hcbf_gym.policies.PDTracker.for_env(env)
    observation, info = env.reset(seed=0)
    begin = time.process_time()
    for _ in range(STEPS):
        observation, _, terminated, _, info = env.step(policy(observation, info))
        assert not terminated
    return time.process_time() - begin


def stage_shares() -> list[Measure]:
    """Time the stages of an episode; what is left over is the environment's and Python's."""
    env = make_env()
    run_episode(env)
    tick = run_episode(env) / (STEPS * 0.02 / DT)
    stages: dict[str, list[tuple[Any, str]]] = {
        "physics (MuJoCo)": [(mujoco, "mj_step1"), (mujoco, "mj_step2")],
        "dynamics, plan, tasks, QP without bounds": [(_core.LocomotionTick, "tick")],
        "QP solver, where a bound binds": [(qp, "solve")],
    }
    with ExitStack() as stack:
        spent = {
            name: [stack.enter_context(_timed(*function)) for function in functions]
            for name, functions in stages.items()
        }
        begin = time.perf_counter()
        run_episode(env)
        altogether = time.perf_counter() - begin
    env.close()
    shares = {name: 100.0 * sum(map(sum, seconds)) / altogether for name, seconds in spent.items()}
    shares["environment and Python"] = 100.0 - sum(shares.values())
    figures = [Measure("a tick of 2 ms", name, share, "%") for name, share in shares.items()]
    return [Measure("a tick of 2 ms", "altogether", 1e6 * tick, "µs"), *figures]


@contextmanager
def _timed(owner: Any, name: str) -> Iterator[list[float]]:
    """Let a function note the seconds of every call in the list returned."""
    inner, spent = getattr(owner, name), list[float]()

    def outer(*args: Any) -> Any:
        begin = time.perf_counter()
        result = inner(*args)
        spent.append(time.perf_counter() - begin)
        return result

    with patch.object(owner, name, outer):
        yield spent
