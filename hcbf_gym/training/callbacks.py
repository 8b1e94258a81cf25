"""Beside the learning: reports with checkpoints, and learning from filtered actions."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback

from hcbf_gym.training import checkpoint
from hcbf_gym.training.config import HELD_OUT, TrainingConfig, make_vector
from hcbf_gym.training.export import export, report


class Reports(BaseCallback):
    """Evaluates on held-out scenes, keeps the best policy, and leaves a checkpoint each time.

    Args:
        config: of the run.
        folder: of the run; `policy.npz` in it is the best one so far.
        curve: the reports so far, extended in place.
        about: how the policy is trained, which is exported with it.
        show: called with the decisions so far at every rollout.
    """

    def __init__(
        self,
        config: TrainingConfig,
        folder: Path,
        curve: list[dict[str, float]],
        about: dict[str, Any],
        show: Callable[[int, list[dict[str, float]]], None],
    ):
        super().__init__()
        self._config, self._folder, self._curve = config, folder, curve
        self._about, self._show = about, show
        self._spent = curve[-1]["seconds_spent"] if curve else 0.0
        self._since = time.monotonic()
        self._due = self._curve[-1]["steps"] + config.report_every if curve else config.report_every

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
        """Evaluate, log, keep the policy if it is the best, and leave a checkpoint."""
        config = self._config
        env = self.model.get_vec_normalize_env()
        assert env is not None
        policy = export(self.model, env, self._about | {"steps": self.num_timesteps})
        env = make_vector(
            config.scenario, config.report_episodes, config.in_the_loop, config.guidance
        )
        result = report(policy, env, HELD_OUT // 2)._asdict()
        for name, value in result.items():
            self.logger.record(f"held_out/{name}", value)
        best = max(((p["success"], p["returns"]) for p in self._curve), default=(-1.0, 0.0))
        if (result["success"], result["returns"]) >= best:
            policy.save(self._folder / "policy.npz")
        spent = self._spent + time.monotonic() - self._since
        self._curve.append({"steps": self.num_timesteps, "seconds_spent": spent, **result})
        self._due = self.num_timesteps + config.report_every
        checkpoint.save(self._folder, config, self.model, self._curve)


class LearnFromFiltered(BaseCallback):
    """Replaces the action that the algorithm remembers by what the filter made of it.

    PPO's log-probability is taken anew for that action, so that its ratio starts at one.
    """

    def _on_step(self) -> bool:
        env = self.model.get_vec_normalize_env()
        assert env is not None
        applied = env.venv.applied.astype(np.float32)  # type: ignore[attr-defined]
        if "log_probs" in self.locals:
            self.locals["actions"][:] = applied
            with torch.no_grad():
                policy, observation = self.model.policy, self.locals["obs_tensor"]
                _, log_probability, _ = policy.evaluate_actions(  # type: ignore[operator]
                    observation, torch.as_tensor(applied)
                )
            self.locals["log_probs"][:] = log_probability
        else:
            self.locals["buffer_actions"][:] = applied
        return True
