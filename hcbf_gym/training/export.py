"""From a trained SB3 model to a policy that needs no SB3, and how well it does."""

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

UNSEEN = 1e-5
"""Variance of an observation's entry below which it counts as constant."""


def export(model: BaseAlgorithm, env: VecNormalize, about: dict[str, Any]) -> LearnedPolicy:
    """Return the model's deterministic policy with the normalisation of its observations."""
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
    # what never varied in training, such as the motion of regions at rest, was never learned from:
    # an infinite scale keeps it at the zero that the network saw
    scale = np.where(variance > UNSEEN, np.sqrt(variance + env.epsilon), np.inf)
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
    """How a policy did over a set of scenes."""

    success: float  # share of episodes that reached the goal
    returns: float  # mean return
    seconds: float  # mean length of an episode [s]
    intervention: float  # mean ‖u − u*‖ over all steps [m/s²]; 0 without a filter


def report(policy: LearnedPolicy, env: VectorEnv, seed: int) -> Report:
    """Run one episode in each of N native environments, with a decision at every control step."""
    run = rollout_batch(env, policy, seed)
    return Report(
        success=float(run.terminated.mean()),
        returns=float(run.reward.sum(axis=0).mean()),
        seconds=float(CONTROL_DT * run.steps.mean()),
        intervention=float(run.intervention.sum() / run.steps.sum()),
    )
