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
    """N episodes, k + 1 states and k steps; k is the length of the longest."""

    time: Array  # (k + 1,) [s]
    position: Array  # (k + 1, N, 2) [m]
    h: Array  # (k + 1, N, m) barrier values at the control times
    min_h: Array  # (N, m) their least values over all physics steps
    tracking_error: Array  # (k + 1, N) ‖p_ref − p‖ [m]
    reward: Array  # (k, N), zero after an episode's end
    intervention: Array  # (k, N) ‖u − u*‖ [m/s²]; zero after an episode's end and without a filter
    delta: Array  # (k, N, m) the program's own relaxation [m/s²], zero in the same places
    deadlock: Mask  # (k, N) whether the robot stood though u* requested motion
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
        policy: acts on all of them at once.
        seed: of the first environment, or of each.
    """
    inner: Any = env.unwrapped
    observed = samples(env, in_double(policy), seed)
    info = next(observed).info
    n, m = info["h"].shape
    idle = {"intervention": np.zeros(n), "delta": np.zeros((n, m))}
    alive, terminated_itself = np.ones(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
    least = info["min_h"].copy()
    position = [inner.rom_state[:, :2]]
    h = [info["h"]]
    error = [info["tracking_error"]]
    reward, intervention, delta, deadlock, running = [], [], [], [], []
    radius = inner.scenes[0].goal_radius
    while alive.any():
        _, info, u, gained, terminated, truncated = next(observed)
        filtered = info.get("safety_filter", idle)
        position.append(inner.rom_state[:, :2])
        h.append(info["h"])
        error.append(info["tracking_error"])
        reward.append(np.where(alive, gained, 0.0))
        intervention.append(np.where(alive, filtered["intervention"], 0.0))
        delta.append(np.where(alive[:, None], filtered["delta"], 0.0))
        stands = deadlocked(inner.rom_state[:, 2:], u, info["tracking_error"], radius)
        deadlock.append(alive & stands)
        running.append(alive.copy())
        least[alive] = np.minimum(least, info["min_h"])[alive]
        terminated_itself |= alive & terminated
        alive &= ~(terminated | truncated)
    env.close()
    time = CONTROL_DT * np.arange(len(h), dtype=np.float64)
    return BatchEpisodes(
        time, np.array(position), np.array(h), least, np.array(error), np.array(reward),
        np.array(intervention), np.array(delta), np.array(deadlock), np.array(running),
        terminated_itself,
    )  # fmt: skip
