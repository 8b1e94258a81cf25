"""N episodes of the reduced-order model at once, each up to its own end."""

from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from hcbf_gym.arrays import Array, Integers, Mask
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation.episode import in_double, samples
from hcbf_gym.evaluation.measures import deadlocked
from hcbf_gym.policies import Policy


class BatchEpisodes(NamedTuple):
    """The records of N episodes with m barriers, of which the longest has k steps."""

    time: Array  # (k + 1,) [s]
    position: Array  # (k + 1, N, 2) [m]
    h: Array  # (k + 1, N, m) barrier values at the control times
    min_h: Array  # (N, m) the least barrier values over all physics steps
    tracking_error: Array  # (k + 1, N) ‖p_ref − p‖ [m]
    reward: Array  # (k, N), zero after an episode's end
    intervention: Array  # (k, N) ‖u − u*‖ [m/s²]; zero after an episode's end and without a filter
    delta: Array  # (k, N, m) the program's own relaxation [m/s²], zero as `intervention` is
    deadlock: Mask  # (k, N) whether the robot was at rest though u* requested motion
    running: Mask  # (k, N) whether the step belongs to the episode
    terminated: Mask  # (N,) whether the episode terminated: in a "reach" scene, at the goal

    @property
    def steps(self) -> Integers:
        """(N,) the length of each episode in control steps."""
        return self.running.sum(axis=0)

    @property
    def seconds_inside(self) -> Array:
        """(N, m) time that each episode spent with h < 0 [s]."""
        return CONTROL_DT * ((self.h[1:] < 0.0) & self.running[..., None]).sum(axis=0)

    @property
    def intervention_rms(self) -> Array:
        """(N,) root mean square of ‖u − u*‖ over each episode [m/s²]."""
        return np.sqrt((self.intervention**2).sum(axis=0) / self.steps)

    @property
    def deadlock_share(self) -> Array:
        """(N,) share of each episode's steps in which it was deadlocked."""
        return self.deadlock.sum(axis=0) / self.steps


def rollout_batch(
    env: gym.vector.VectorEnv, policy: Policy, seed: int | list[int]
) -> BatchEpisodes:
    """Run an episode in each of N environments to its end, and close them.

    Args:
        env: native environments of this package with ``autoreset_mode="Disabled"``, filtered or
            not.
        policy: returns the inputs (N, 2) of all environments at once.
        seed: the seed of the first environment, or those of all.
    """
    inner: Any = env.unwrapped
    episode = samples(env, in_double(policy), seed)
    info = next(episode).info
    n, m = info["h"].shape
    without_filter = {"intervention": np.zeros(n), "delta": np.zeros((n, m))}
    is_running, has_terminated = np.ones(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
    min_h = info["min_h"].copy()
    position = [inner.rom_state[:, :2]]
    h = [info["h"]]
    error = [info["tracking_error"]]
    reward, intervention, delta, deadlock, running = [], [], [], [], []
    radius = inner.scenes[0].goal_radius
    while is_running.any():
        _, info, u, step_reward, terminated, truncated = next(episode)
        report = info.get("safety_filter", without_filter)
        position.append(inner.rom_state[:, :2])
        h.append(info["h"])
        error.append(info["tracking_error"])
        reward.append(np.where(is_running, step_reward, 0.0))
        intervention.append(np.where(is_running, report["intervention"], 0.0))
        delta.append(np.where(is_running[:, None], report["delta"], 0.0))
        is_deadlocked = deadlocked(inner.rom_state[:, 2:], u, info["tracking_error"], radius)
        deadlock.append(is_running & is_deadlocked)
        running.append(is_running.copy())
        min_h[is_running] = np.minimum(min_h, info["min_h"])[is_running]
        has_terminated |= is_running & terminated
        is_running &= ~(terminated | truncated)
    env.close()
    return BatchEpisodes(
        time=CONTROL_DT * np.arange(len(h), dtype=np.float64),
        position=np.array(position),
        h=np.array(h),
        min_h=min_h,
        tracking_error=np.array(error),
        reward=np.array(reward),
        intervention=np.array(intervention),
        delta=np.array(delta),
        deadlock=np.array(deadlock),
        running=np.array(running),
        terminated=has_terminated,
    )
