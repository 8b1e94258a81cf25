"""The native vector environment as Stable-Baselines3 expects a VecEnv; needs the extra `rl`."""

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from hcbf_gym.arrays import Array, Info
from hcbf_gym.errors import InvalidInputError, MissingDependencyError, install
from hcbf_gym.wrappers.filter_log import FilterLog

try:
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise MissingDependencyError(
        f"SB3 adapter: got no stable_baselines3, expected the extra rl: {install('rl')}"
    ) from error


class Sb3VecEnv(VecEnv):
    """N native environments behind SB3's interface, actions scaled to [−1, 1].

    Finished episodes restart within the step; their last observation, return, length and success
    are in the infos under SB3's names, beside what a single environment reports.

    Args:
        env: ``gym.make_vec("HCBF-Regions-v0", num_envs=N, autoreset_mode="Disabled", …)``,
            possibly in vector wrappers, such as ``VectorHoldAction(env, 5, "Disabled")``.

    Raises:
        InvalidInputError: if the environment resets itself.

    Attributes:
        applied: (N, 2) the actions that reached the robots in the last step, in [−1, 1], after a
            filter's changes; their mean where a decision is held.
    """

    def __init__(self, env: VectorEnv):
        if env.metadata["autoreset_mode"] is not AutoresetMode.DISABLED:
            raise InvalidInputError(
                f"autoreset_mode: got {env.metadata['autoreset_mode']}, expected 'Disabled'"
            )
        self.env = env
        bounds = env.single_action_space
        assert isinstance(bounds, spaces.Box)
        self._center = 0.5 * (bounds.high + bounds.low).astype(np.float64)
        self._half_range = 0.5 * (bounds.high - bounds.low).astype(np.float64)
        self.applied = np.zeros((env.num_envs, 2))
        self._actions = self.applied
        self._returns = np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, dtype=np.int64)
        normalized = spaces.Box(-1.0, 1.0, (2,), np.float32)
        super().__init__(env.num_envs, env.single_observation_space, normalized)

    def reset(self) -> Array:
        """Start new episodes everywhere, with the seed that the method `seed` set."""
        observation, infos = self.env.reset(seed=self._seeds[0])
        self.reset_infos = _split(infos)
        self._reset_seeds()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        return observation

    def step_async(self, actions: Array) -> None:
        """Store the actions (N, 2) in [−1, 1] for `step_wait`."""
        self._actions = np.asarray(actions, dtype=np.float64)

    def step_wait(self) -> tuple[Array, Array, NDArray[np.bool_], list[Info]]:
        """Step all environments with the stored actions, and reset those that have ended."""
        u = self._center + self._half_range * self._actions
        observation, reward, terminated, truncated, info = self.env.step(u)
        safe = info["safety_filter"]["u_safe"] if "safety_filter" in info else u
        self.applied = (safe - self._center) / self._half_range
        self._returns += reward
        self._lengths += 1
        infos = _split(info)
        done = terminated | truncated
        for i in np.flatnonzero(done):
            infos[i] |= {
                "terminal_observation": observation[i],
                "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i]), "t": 0.0},
            }
        if done.any():
            self._returns[done], self._lengths[done] = 0.0, 0
            fresh, _ = self.env.reset(options={"reset_mask": done})
            observation = np.where(done[:, None], fresh, observation)
        return observation, reward, done, infos

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return each environment's attribute, or a wrapper's for all of them."""
        wrapper: Any = self.env
        while wrapper is not wrapper.unwrapped and not hasattr(wrapper, attr_name):
            wrapper = wrapper.env
        if wrapper is wrapper.unwrapped:
            values = wrapper.get_attr(attr_name)
        else:
            values = [getattr(wrapper, attr_name)] * self.num_envs
        return [values[i] for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: object, indices: Any = None) -> None:
        """Raise an `InvalidInputError`, because the environments share their attributes."""
        raise InvalidInputError(
            f"set_attr: got {attr_name!r}, expected the environment's own calls"
        )

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        """Raise an `InvalidInputError`, because there are no single environments to call."""
        raise InvalidInputError(f"env_method: got {method_name!r}, expected the vector's own calls")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return False for each index: episodes are recorded by the adapter itself."""
        return [False for _ in self._get_indices(indices)]


class FilterCallback(BaseCallback):
    """Logs the filters' reports between two updates to TensorBoard, or any other logger of SB3.

    ``filter/status_…`` is the share of each status, ``filter/least_h_rank_…`` the least h of each
    rank, ``filter/intervention`` the mean of ‖u − u*‖, over all environments, which must be
    filtered: ``model.learn(100_000, callback=FilterCallback())``.
    """

    def _on_training_start(self) -> None:
        try:
            conditions = self.training_env.get_attr("conditions", [0])[0]
        except AttributeError as error:
            raise InvalidInputError(
                "filter callback: got environments without a filter, expected SafetyFilter or "
                "VectorSafetyFilter around them"
            ) from error
        self._log = FilterLog(conditions)

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            self._log.add(info["safety_filter"])
        return True

    def _on_rollout_end(self) -> None:
        for name, value in self._log.scalars().items():
            self.logger.record(name, value)


def _split(infos: Info) -> list[Info]:
    """Return the N infos of single environments, from those of the vector environment."""
    columns = {
        key: _split(value) if isinstance(value, dict) else value
        for key, value in infos.items()
        if not key.startswith("_")  # a mask of the environments that report
    }
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
