"""How fast the walk runs, beside MuJoCo alone in the same run and a peer where it is installed.

Episodes are timed in CPU seconds of this process, which runs on one core: what other processes do
meanwhile does not count.
"""

import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

import hcbf_gym
from hcbf_gym.benchmarks.figure import Figure
from hcbf_gym.locomotion.controller import LocomotionController

Array = NDArray[np.float64]

STEPS = 1000  # of 20 ms
DT = 0.002


def speed_figures(quick: bool) -> list[Figure]:
    """Return real-time factors, the stages of a tick and the peer's figures."""
    repetitions = 2 if quick else 5
    condensed, alone = time_episodes(repetitions, "condensed")
    full, _ = time_episodes(repetitions, "full")
    ratio = float(np.median(alone / condensed))
    figures = [
        Figure("speed", "real-time factor", real_time(condensed), "×", 25.0, True),
        Figure("speed", "real-time factor, full QP form", real_time(full), "×", 18.0, True),
        Figure("speed", "real-time factor of MuJoCo alone", real_time(alone), "×"),
        Figure("speed", "share of MuJoCo's own speed", ratio, "", 0.3, True),
    ]
    return [*figures, *stage_shares(), *peer_figures(repetitions)]


def real_time(seconds: Array) -> float:
    """Return simulated seconds per second, median over the runs."""
    return float(np.median(STEPS * 0.02 / seconds))


def time_episodes(repetitions: int, formulation: str) -> tuple[Array, Array]:
    """Return (n,) seconds of an episode in the environment, and of MuJoCo under its torques."""
    env, torques, start = recorded_episode(formulation)
    core: Any = env.unwrapped
    model, data = core.simulation.model, core.simulation.data
    with_control, alone = [], []
    for _ in range(repetitions):
        with_control.append(run_episode(env))
        mujoco.mj_resetData(model, data)
        data.qpos[:] = start
        ctrl = data.ctrl
        begin = time.process_time()
        for torque in torques:
            ctrl[:] = torque
            mujoco.mj_step(model, data)
        alone.append(time.process_time() - begin)
    env.close()
    return np.array(with_control), np.array(alone)


def make_env(formulation: str) -> gym.Env[Any, Any]:
    """Return the paper's course on the A1, its controller in the form asked for."""
    env = gym.make("HCBF-A1Regions-v0", scenario="paper-simulation")
    core: Any = env.unwrapped
    core.controller = LocomotionController(max_speed=1.2, formulation=formulation)
    return env


def recorded_episode(formulation: str) -> tuple[gym.Env[Any, Any], Array, Array]:
    """Return the environment after an episode, every torque of it (n, 12), and the first qpos."""
    env = make_env(formulation)
    core: Any = env.unwrapped
    simulation, torques = core.simulation, []
    step = simulation.step

    def recorded(torque: Array) -> None:
        torques.append(torque.copy())
        step(torque)

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


def stage_shares() -> list[Figure]:
    """Time the stages of an episode; what is left over is the environment's and Python's."""
    env = make_env("condensed")
    core: Any = env.unwrapped
    run_episode(env)
    ticks = STEPS * 0.02 / DT
    tick = run_episode(env) / ticks
    stages = {
        "physics (MuJoCo)": (core.simulation, "step"),
        "state, as sensed": (core.simulation, "state"),
        "dynamics, plan, tasks and QP": (core.controller._form, "step"),
    }
    spent = {name: _timed(owner, method) for name, (owner, method) in stages.items()}
    timed_tick = run_episode(env) / ticks
    env.close()
    figures = [
        Figure("a tick of 2 ms", name, 100.0 * float(np.median(seconds)) / timed_tick, "%")
        for name, seconds in spent.items()
    ]
    return [Figure("a tick of 2 ms", "altogether", 1e6 * tick, "µs"), *figures]


def _timed(owner: Any, method: str) -> list[float]:
    """Replace a method by one that notes the seconds of every call in the list returned."""
    inner: Callable[..., Any] = getattr(owner, method)
    spent: list[float] = []

    def outer(*args: Any) -> Any:
        begin = time.perf_counter()
        result = inner(*args)
        spent.append(time.perf_counter() - begin)
        return result

    setattr(owner, method, outer)
    return spent


def peer_figures(repetitions: int) -> list[Figure]:
    """Time gym-quadruped, which steps without a controller, where it is installed."""
    try:
        from gym_quadruped.quadruped_env import (  # pyright: ignore[reportMissingImports]
            QuadrupedEnv,
        )
    except ImportError:
        return []
    figures = []
    for name, observations in (
        ("with all observations", tuple(QuadrupedEnv.ALL_OBS)),
        ("with qpos alone", ("qpos",)),
    ):
        env = QuadrupedEnv(robot="go1", state_obs_names=observations, sim_dt=DT)
        env.reset(random=False)
        action = np.zeros(env.mjModel.nu)
        seconds = []
        for _ in range(repetitions):
            begin = time.process_time()
            for _ in range(1000):
                env.step(action)
            seconds.append(time.process_time() - begin)
        factor = float(np.median(1000 * DT / np.array(seconds)))
        label = f"real-time factor, {name}"
        figures.append(Figure("gym-quadruped, no controller", label, factor, "×"))
    return figures
