"""How fast the walk runs, beside MuJoCo alone in the same run.

Episodes are timed in CPU seconds of this process, which runs on one core: what other processes do
meanwhile does not count.
"""

import time
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np

import hcbf_gym
from benchmarks.suites.walks import Measure
from hcbf_gym.arrays import Array
from hcbf_gym.locomotion.controller import LocomotionController

STEPS = 1000  # of 20 ms


def speed_figures(quick: bool) -> list[Measure]:
    """Return the real-time factor, and the share of MuJoCo's own."""
    repetitions = 1 if quick else 5
    walking, alone = time_episodes(repetitions)
    ratio = float(np.median(alone / walking))
    factor = float(np.median(STEPS * 0.02 / walking))
    return [
        Measure("speed", "real-time factor", factor, "×", 25.0, True),
        Measure("speed", "share of MuJoCo's own speed", ratio, "", 0.3, True),
    ]


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


def recorded_episode() -> tuple[gym.Env[Any, Any], Array, Array]:
    """Return the environment after an episode, every torque of it (n, 12), and the first qpos."""
    env = gym.make("HCBF-A1Regions-v0", scenario="paper-simulation")
    core: Any = env.unwrapped
    core.drive.controller = LocomotionController(max_speed=1.2)
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
