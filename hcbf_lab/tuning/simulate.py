"""Trajectories under many weights: a batch with one reduced-order robot for each pair (γ₀, Δγ)."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import policies, wrappers
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.evaluation.batch import rollout_batch
from hcbf_lab.tuning.cost import relaxation


class Trajectories(NamedTuple):
    """N trajectories of k steps in one scene."""

    time: Array  # (k + 1,) [s]
    position: Array  # (k + 1, N, 2) [m]
    h: Array  # (k + 1, N, m) barrier values at the control times
    min_h: Array  # (N, m) least barrier values over all physics steps
    # (k + 1, N) ‖p_ref − p‖ [m]. After an early end of an episode it is zero, except for the last
    # entry, which is always the error at the episode's end
    tracking_error: Array
    relaxation: Array  # (k, N) Σ_k max(0, δ_k) [m/s²]; zero after an episode's end
    fell: Mask  # (N,) whether the robot fell; the reduced-order model cannot


def check_weights(gamma0: ArrayLike, delta_gamma: ArrayLike) -> tuple[Array, Array]:
    """Return γ₀ and Δγ as arrays (N,).

    Raises:
        InvalidInputError: if they are empty, of different lengths, negative or not finite.
    """
    weights = np.array(gamma0, dtype=np.float64), np.array(delta_gamma, dtype=np.float64)
    if weights[0].ndim != 1 or weights[0].size == 0 or weights[0].shape != weights[1].shape:
        raise InvalidInputError(
            f"gamma0, delta_gamma: got shapes {weights[0].shape} and {weights[1].shape}, "
            "expected (N,) both, N >= 1"
        )
    for name, values in zip(("gamma0", "delta_gamma"), weights, strict=True):
        if not (np.isfinite(values).all() and (values >= 0.0).all()):
            raise InvalidInputError(f"{name}: got {values.tolist()}, expected numbers >= 0")
    return weights


def simulate(
    scenario: Any,
    program: str,
    gamma0: ArrayLike,
    delta_gamma: ArrayLike,
    options: Mapping[str, Any] | None = None,
    seed: int = 0,
) -> Trajectories:
    """Return the trajectories of N reduced-order robots in one scene, each with its own weights.

    Args:
        scenario: as `hcbf_gym.scenarios.make` takes it.
        program: a program with both weights as options.
        gamma0: (N,) γ₀ ≥ 0.
        delta_gamma: (N,) Δγ ≥ 0.
        options: further options of the filter.
        seed: of every environment, so that all have the same scene.

    Raises:
        InvalidInputError: if a weight is negative or not finite, or there are none.
    """
    gamma0, delta_gamma = check_weights(gamma0, delta_gamma)
    n = len(gamma0)
    env = wrappers.VectorSafetyFilter(
        gym.make_vec(
            "HCBF-Regions-v0",
            num_envs=n,
            scenario=scenario,  # type: ignore[arg-type]
            autoreset_mode="Disabled",  # type: ignore[arg-type]
        ),
        program=program,
        gamma0=gamma0[:, None],
        delta_gamma=delta_gamma[:, None],
        **(options or {}),
    )
    inner: Any = env.unwrapped
    episodes = rollout_batch(env, policies.PDTracker.for_env(env), [seed] * n)
    # An episode costs nothing after its end, and the last entry of the cost is the final error.
    final_error = episodes.tracking_error[episodes.steps, np.arange(n)]
    error = episodes.tracking_error.copy()
    error[1:][~episodes.running] = 0.0
    error[-1] = final_error
    return Trajectories(
        time=episodes.time,
        position=episodes.position,
        h=episodes.h,
        min_h=episodes.min_h,
        tracking_error=error,
        relaxation=relaxation(episodes.delta, inner.barrier_set.priority[0]),
        fell=np.zeros(n, dtype=np.bool_),
    )
