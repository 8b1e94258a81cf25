"""Callbacks of Stable-Baselines3 (SB3): reports with checkpoints, learning from applied actions."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize

from hcbf_gym.training import checkpoint
from hcbf_gym.training.config import HELD_OUT, Curve, Show, TrainingConfig, make_vector
from hcbf_gym.training.export import export, report

REPORT_SEED = HELD_OUT // 2  # between the scenes of evaluations, which begin at 0, and of training


class Reports(BaseCallback):
    """Evaluates the policy on held-out scenes, saves the best one, and saves checkpoints.

    Args:
        config: the configuration of the run.
        folder: the folder of the run; `policy.npz` in it is the best policy so far.
        curve: the reports so far, extended in place.
        about: configuration and versions, which are exported with the policy.
        show: called with the decisions so far and the curve at every rollout.
    """

    def __init__(
        self, config: TrainingConfig, folder: Path, curve: Curve, about: dict[str, Any], show: Show
    ):
        super().__init__()
        self._config, self._folder, self._curve = config, folder, curve
        self._about, self._show = about, show
        self._spent_before = curve[-1]["seconds_spent"] if curve else 0.0  # of a resumed run [s]
        self._began = time.monotonic()
        self._due = config.report_every + (curve[-1]["steps"] if curve else 0)

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        self._show(self.num_timesteps, self._curve)
        if self.num_timesteps >= self._due:
            self.report()

    def _on_training_end(self) -> None:
        if not self._curve or self._curve[-1]["steps"] < self.num_timesteps:
            self.report()
        self._show(self.num_timesteps, self._curve)

    def report(self) -> None:
        """Evaluate the policy, log the result, save the best policy, and save a checkpoint."""
        config = self._config
        about = self._about | {"steps": self.num_timesteps}
        policy = export(self.model, _normalized(self), about)
        held_out = make_vector(
            config.scenario, config.report_episodes, config.in_the_loop, config.guidance
        )
        result = report(policy, held_out, REPORT_SEED)._asdict()
        for name, value in result.items():
            self.logger.record(f"held_out/{name}", value)
        if self._is_best(result):
            policy.save(self._folder / "policy.npz")
        spent = self._spent_before + time.monotonic() - self._began
        self._curve.append({"steps": self.num_timesteps, "seconds_spent": spent, **result})
        self._due = self.num_timesteps + config.report_every
        checkpoint.save(self._folder, config, self.model, self._curve)

    def _is_best(self, result: dict[str, float]) -> bool:
        """Return whether no earlier report has a greater success or, at equal success, return."""
        score = result["success"], result["returns"]
        return all(score >= (earlier["success"], earlier["returns"]) for earlier in self._curve)


class LearnFromFiltered(BaseCallback):
    """Replaces each action that the algorithm stores by the filtered one, which was applied.

    SB3 calls `_on_step` between a step and its storage, with the local variables of
    `collect_rollouts` in `self.locals`. Their arrays are stored afterwards, so that writing into
    them changes what is learned from. PPO's log-probability is computed for the new action, so that
    its ratio π_new(a|s) / π_old(a|s) starts at one.
    """

    def _on_step(self) -> bool:
        environments: Any = _normalized(self).venv  # `Sb3VecEnv`
        applied = environments.applied.astype(np.float32)  # (N, 2)
        if "log_probs" in self.locals:  # `OnPolicyAlgorithm`, the base of PPO
            self.locals["log_probs"][:] = self._log_probability(applied)  # (N,)
            self.locals["actions"][:] = applied  # (N, 2)
        else:  # `OffPolicyAlgorithm`, the base of SAC and TD3, with a replay buffer
            self.locals["buffer_actions"][:] = applied  # (N, 2)
        return True

    def _log_probability(self, actions: NDArray[np.float32]) -> torch.Tensor:
        """Return (N,) the log-probability of actions (N, 2) under the present policy."""
        policy: Any = self.model.policy
        with torch.no_grad():
            return policy.evaluate_actions(self.locals["obs_tensor"], torch.as_tensor(actions))[1]


def _normalized(callback: BaseCallback) -> VecNormalize:
    """Return the training environments in the normalisation that `make_env` puts around them."""
    env = callback.model.get_vec_normalize_env()
    assert env is not None
    return env
