"""Export of a trained SB3 model as a policy that needs no SB3, and the policy's evaluation."""

from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation.batch import rollout_batch
from hcbf_gym.policies.learned import LearnedPolicy

LEAST_VARIANCE = 1e-5  # with less variance an entry of the observation counts as constant


def export(model: BaseAlgorithm, env: VecNormalize, about: dict[str, Any]) -> LearnedPolicy:
    """Return a model's deterministic policy with the normalisation of its environments."""
    policy: Any = model.policy
    if isinstance(model, PPO):
        modules = [*policy.mlp_extractor.policy_net, policy.action_net]
    elif isinstance(model, SAC):
        modules = [*policy.actor.latent_pi, policy.actor.mu]
    else:
        modules = list(policy.actor.mu)
    linear = [module for module in modules if isinstance(module, torch.nn.Linear)]
    bounds = env.get_attr("single_action_space")[0]
    assert isinstance(bounds, spaces.Box)
    variance = env.obs_rms.var  # type: ignore[union-attr]
    # Entries that were constant in training, such as the velocity of regions at rest, were zero for
    # the network after normalisation. An infinite scale keeps them at zero.
    scale = np.where(variance > LEAST_VARIANCE, np.sqrt(variance + env.epsilon), np.inf)
    return LearnedPolicy(
        weights=tuple(layer.weight.detach().double().numpy().copy() for layer in linear),
        biases=tuple(layer.bias.detach().double().numpy().copy() for layer in linear),
        mean=env.obs_rms.mean.copy(),  # type: ignore[union-attr]
        scale=scale,
        low=bounds.low.astype(np.float64),
        high=bounds.high.astype(np.float64),
        activation="tanh" if isinstance(model, PPO) else "relu",
        squash="clip" if isinstance(model, PPO) else "tanh",
        about=about,
    )


class Report(NamedTuple):
    """The figures of a policy over a set of scenes."""

    success: float  # share of episodes that reached the goal
    returns: float  # mean return
    seconds: float  # mean length of an episode [s]
    intervention: float  # mean ‖u − u*‖ over all steps [m/s²]; 0 without a filter


def report(policy: LearnedPolicy, env: VectorEnv, seed: int) -> Report:
    """Return the figures of one episode in each native environment, with a decision every step."""
    episodes = rollout_batch(env, policy, seed)
    return Report(
        success=float(episodes.terminated.mean()),
        returns=float(episodes.reward.sum(axis=0).mean()),
        seconds=float(CONTROL_DT * episodes.steps.mean()),
        intervention=float(episodes.intervention.sum() / episodes.steps.sum()),
    )
