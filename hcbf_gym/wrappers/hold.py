"""HoldAction: an action that is held for several control steps counts as one decision."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.core import ActType, ObsType
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv, VectorWrapper

from hcbf_gym.arrays import Array, Info, Mask
from hcbf_gym.envs import infos as vector_infos
from hcbf_gym.errors import InvalidInputError, count
from hcbf_gym.wrappers.arguments import record

SUMMED = ("cost", "costs", "fallbacks")
LEAST = ("min_h",)
GREATEST = ("status", "reason", "slack", "model_error", "obstacle_force")
AVERAGED = ("u_safe", "intervention", "deadlock")
"""How infos of several steps become one. The reward's terms are summed; all others are the last."""


class HoldAction(gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs):
    """Holds each action for several steps of the environment, or until the episode ends.

    Rewards, their terms in the infos, `cost` and `costs` are summed; `min_h` is the least; of the
    filter's report, `status`, `reason`, `slack` and `model_error` are the greatest, `u_safe`,
    `intervention` and `deadlock` the mean, `fallbacks` the sum. All other infos are of the last
    step. It belongs outside the filter, which then filters in every step.

    Args:
        env: any environment, filtered or not.
        steps: the number of steps for which an action is held.

    Raises:
        InvalidInputError: if `steps` is no integer from 1 on.
    """

    def __init__(self, env: gym.Env[ObsType, ActType], steps: int):
        self.steps = count("steps", steps)
        record(self, env, gym.Env, steps=steps)
        gym.Wrapper.__init__(self, env)

    def step(self, action: ActType) -> tuple[ObsType, float, bool, bool, Info]:
        """Hold the action; return the last observation, summed reward, ends and merged infos."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        total = float(reward)
        for k in range(2, self.steps + 1):
            if terminated or truncated:
                break
            observation, reward, terminated, truncated, step_info = self.env.step(action)
            total += float(reward)
            info = _merge(info, step_info, k)
        return observation, total, terminated, truncated, info


class VectorHoldAction(VectorWrapper, RecordConstructorArgs):
    """`HoldAction` for the native vector environment: equal to it around each single environment.

    An environment whose episode ends within a hold reports its state of that time. It is reset when
    the hold is over.

    Args:
        env: ``gym.make_vec("HCBF-Regions-v0", num_envs=N, autoreset_mode="Disabled")``, possibly in
            vector wrappers.
        steps: the number of steps for which an action is held.
        autoreset_mode: Gymnasium's "NextStep", "SameStep" or "Disabled", for held decisions.

    Raises:
        InvalidInputError: if `steps` is no integer from 1 on, the environment resets itself,
            or it joins single ones, around each of which a `HoldAction` belongs.
    """

    def __init__(
        self,
        env: VectorEnv,
        steps: int,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
    ):
        self.steps = count("steps", steps)
        self.autoreset_mode = vector_infos.mode_of(autoreset_mode)
        record(self, env, VectorEnv, steps=steps, autoreset_mode=self.autoreset_mode.value)
        if isinstance(env.unwrapped, SyncVectorEnv | AsyncVectorEnv):
            raise InvalidInputError(
                f"environment: got {env}, expected the native vector environment; around single "
                "environments put a HoldAction on each before they are joined"
            )
        if env.metadata["autoreset_mode"] is not AutoresetMode.DISABLED:
            raise InvalidInputError(
                f"environment: got autoreset_mode {env.metadata['autoreset_mode']}, expected "
                "'Disabled'; give VectorHoldAction the mode instead"
            )
        VectorWrapper.__init__(self, env)
        self.metadata = env.metadata | {"autoreset_mode": self.autoreset_mode}
        self._ended = np.zeros(env.num_envs, dtype=np.bool_)

    def reset(
        self, *, seed: Any = None, options: dict[str, object] | None = None
    ) -> tuple[Any, Info]:
        """Start new episodes."""
        self._ended[:] = False
        return self.env.reset(seed=seed, options=options)

    def step(self, actions: Any) -> tuple[Any, Array, Mask, Mask, Info]:
        """Hold the actions; return last observations, summed rewards, ends and merged infos."""
        observation, reward, terminated, truncated, infos = self.env.step(actions)
        for k in range(2, self.steps + 1):
            running = ~(terminated | truncated)
            if not running.any():
                break
            seen, step_reward, terminates, truncates, step_infos = self.env.step(actions)
            observation = np.where(running[:, None], seen, observation)
            reward = reward + running * step_reward
            terminated = terminated | (running & terminates)
            truncated = truncated | (running & truncates)
            infos = _merge(infos, step_infos, k, running)
        return self._reset_ended(observation, reward, terminated, truncated, infos)

    def _reset_ended(
        self, observation: Any, reward: Array, terminated: Mask, truncated: Mask, infos: Info
    ) -> tuple[Any, Array, Mask, Mask, Info]:
        """Reset the environments whose episodes have ended, as the autoreset mode requires."""
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and self._ended.any():
            restarted = self._ended
            fresh, fresh_infos = self.env.reset(options={"reset_mask": restarted})
            observation = np.where(restarted[:, None], fresh, observation)
            reward = np.where(restarted, 0.0, reward)
            terminated, truncated = terminated & ~restarted, truncated & ~restarted
            vector_infos.replace_masked(infos, restarted, fresh_infos)
        ended = terminated | truncated
        self._ended = ended
        if self.autoreset_mode is AutoresetMode.SAME_STEP and ended.any():
            fresh, fresh_infos = self.env.reset(options={"reset_mask": ended})
            vector_infos.move_to_final(infos, ended, observation, fresh_infos)
            observation = np.where(ended[:, None], fresh, observation)
        return observation, reward, terminated, truncated, infos


def _merge(held: Info, step: Info, k: int, running: Mask | None = None) -> Info:
    """Return the infos of k steps of a decision, from the merged first k − 1 and from step k.

    Environments (N,) that are not `running` keep theirs, as their episodes ended before step k.
    """
    merged: Info = {}
    for key, value in step.items():
        if key not in held:
            merged[key] = value
        elif isinstance(value, dict):
            merged[key] = _merge(held[key], value, k, running)
        else:
            merged[key] = _combine(key, held[key], value, k)
            if running is not None and not running.all():
                is_running = running.reshape(-1, *[1] * (np.ndim(value) - 1))
                merged[key] = np.where(is_running, merged[key], held[key])
    return merged


def _combine(key: str, held: Any, value: Any, k: int) -> Any:
    """Return one info of k steps, from that of the first k − 1 and that of step k."""
    if key.startswith("reward_") or key in SUMMED:
        return held + value
    if key in LEAST:
        return np.minimum(held, value)
    if key in GREATEST:
        return np.maximum(held, value)
    if key in AVERAGED:
        return held + (value - held) / k
    return value
