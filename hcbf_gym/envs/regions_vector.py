"""HCBF-Regions-v0 as a native vector environment: N robots stepped by one compiled call."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from hcbf_gym import scenarios
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs import task
from hcbf_gym.envs.plants import plant_of
from hcbf_gym.envs.regions_batch import RegionsBatch
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.plant import Estimate, Plant
from hcbf_gym.scenarios import Scenario, random_scenes

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class RegionsVectorEnv(VectorEnv[Array, Array, NDArray[Any]]):
    """N copies of `RegionsEnv`, with the same trajectories as N single environments.

    Environment i is seeded with ``seed + i``, as in Gymnasium's own vector environments.

    Args:
        num_envs: N.
        scenario: as `RegionsEnv` takes it.
        max_episode_steps: after which an episode is truncated.
        autoreset_mode: Gymnasium's "NextStep", "SameStep" or "Disabled".

    Raises:
        InvalidInputError: if an argument is out of range.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Path | Mapping[str, Any] | Scenario = "paper-simulation",
        max_episode_steps: int = task.MAX_EPISODE_STEPS,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: None = None,
    ):
        if num_envs < 1 or max_episode_steps < 1:
            raise InvalidInputError(
                f"got num_envs {num_envs} and max_episode_steps {max_episode_steps}, expected >= 1"
            )
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError as error:
            choices = [mode.value for mode in AutoresetMode]
            raise InvalidInputError(
                f"autoreset_mode: got {autoreset_mode!r}, expected one of {choices}"
            ) from error
        if render_mode is not None:
            raise InvalidInputError(f"render_mode: got {render_mode!r}, expected None")
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.render_mode = None
        self.num_envs = num_envs
        self.max_episode_steps = max_episode_steps
        self._random = scenarios.is_random(scenario)
        self._source = scenario
        self._rngs = [np.random.default_rng() for _ in range(num_envs)] if self._random else []
        self.scenario = scenarios.make(scenario, np.random.default_rng(0))
        self._layouts: list[random_scenes.Layout | None] = [None] * num_envs
        self._batch = RegionsBatch([self.scenario] * num_envs, own_references=self._random)
        self._done = np.zeros(num_envs, dtype=np.bool_)
        self.single_action_space = task.action_space(self.scenario.input_set)
        self.single_observation_space = task.observation_space(len(self.scenario.barriers))
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    @property
    def scenes(self) -> list[Scenario]:
        """The scene of each environment now."""
        return [
            self.scenario if layout is None else random_scenes.scenario(str(self._source), layout)
            for layout in self._layouts
        ]

    @property
    def rom_state(self) -> Array:
        """(N, 4) positions [m] and velocities [m/s]."""
        return self._batch.x.copy()

    @property
    def plant(self) -> Plant:
        """What a safety filter must know."""
        return plant_of(self)

    @property
    def estimate(self) -> Estimate:
        """The N states, which are known exactly."""
        return Estimate(self.rom_state, self.time)

    @property
    def goal(self) -> Array:
        """(N, 2) where the references end [m]."""
        return self._batch.goal

    @property
    def barrier_set(self) -> BarrierSet:
        """The barriers of the N scenes."""
        return self._batch.barrier_set

    @property
    def time(self) -> Array:
        """(N,) since each environment's reset [s]."""
        return self._batch.time

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """Start new episodes in all environments, or in those of ``options["reset_mask"]``."""
        mask = np.ones(self.num_envs, dtype=np.bool_)
        if options is not None and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
                raise InvalidInputError(
                    f"reset_mask: got shape {mask.shape} of {mask.dtype}, "
                    f"expected ({self.num_envs},) of bool with a True"
                )
        self._seed(seed)
        self._draw_scenes(mask)
        self._batch.restart(mask)
        self._done[mask] = False
        observation, h, error = self._batch.look()
        return observation, self._infos(task.step_info(h, h.copy(), error))

    def step(self, actions: Array) -> tuple[Array, Array, Mask, Mask, dict[str, Any]]:
        """Hold the accelerations (N, 2) [m/s²] for one control step."""
        u = task.check_action(actions, (self.num_envs, 2))
        restarting = self._done.copy() if self.autoreset_mode is AutoresetMode.NEXT_STEP else None
        if restarting is not None and restarting.any():
            self._draw_scenes(restarting)
        step = self._batch.step(u, restarting)
        reward = np.sum(list(step.reward_terms.values()), axis=0)
        terminated = step.reached
        truncated = (self._batch.steps >= self.max_episode_steps) & ~terminated
        self._done = terminated | truncated
        infos = self._infos(step.info | step.reward_terms)
        if self.autoreset_mode is not AutoresetMode.SAME_STEP or not self._done.any():
            return step.observation, reward, terminated, truncated, infos
        return self._start_over(step.observation, infos), reward, terminated, truncated, infos

    def _start_over(self, observation: Array, infos: dict[str, Any]) -> Array:
        """Restart what has ended within the same step; the last observation goes into infos."""
        done = self._done.copy()
        final_info = {key: value.copy() for key, value in infos.items()}
        infos["final_obs"], infos["_final_obs"] = observation, done
        infos["final_info"], infos["_final_info"] = final_info, done.copy()
        self._draw_scenes(done)
        self._batch.restart(done)
        self._done[:] = False
        restarted, h, error = self._batch.look()
        for key, value in task.step_info(h, h.copy(), error).items():
            infos[key][done] = value[done]
        return restarted

    def _seed(self, seed: int | Sequence[int | None] | None) -> None:
        if seed is None or not self._random:
            return
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else seed
        if len(seeds) != self.num_envs:
            raise InvalidInputError(f"seed: got {len(seeds)} seeds, expected {self.num_envs}")
        for i, one in enumerate(seeds):
            if one is not None:
                self._rngs[i], _ = seeding.np_random(one)

    def _draw_scenes(self, mask: Mask) -> None:
        if not self._random:
            return
        moving = scenarios.RANDOM[str(self._source)]
        for i in np.flatnonzero(mask):
            layout = random_scenes.draw(self._rngs[i], moving)
            self._layouts[i] = layout
            self._batch.set_layout(int(i), layout)

    def _infos(self, info: dict[str, Array]) -> dict[str, Any]:
        """Return Gymnasium's vector form: each entry with a mask of who reports it."""
        masks = {f"_{key}": np.ones(self.num_envs, dtype=np.bool_) for key in info}
        return info | masks
