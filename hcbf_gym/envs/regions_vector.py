"""HCBF-Regions-v0 as a native vector environment: N robots stepped by one compiled call."""

from collections import deque
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from hcbf_gym.arrays import Array, Info, Mask
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs import checks, task
from hcbf_gym.envs import infos as vector_infos
from hcbf_gym.envs.plants import RankedRegions, exact_model
from hcbf_gym.envs.regions_batch import RegionsBatch
from hcbf_gym.envs.scene_source import SceneSource
from hcbf_gym.errors import InvalidInputError, count
from hcbf_gym.models.plant import Estimate
from hcbf_gym.scenarios import Scenario, ScenarioLike, Scene

if TYPE_CHECKING:
    from hcbf_gym.drawing.top_down import TopDownView

PICTURE_SIDE = 240  # of each environment [pixels]


class RegionsVectorEnv(  # pyright: ignore[reportIncompatibleVariableOverride] - spec, see there
    RankedRegions, VectorEnv[Array, Array, NDArray[Any]]
):
    """N copies of `RegionsEnv`, with the trajectories and infos of N single environments.

    Environment i is seeded with ``seed + i``, as in Gymnasium's own vector environments. With mode
    "Disabled" an environment that has ended steps on until it is reset.

    Args:
        num_envs: N.
        scenario: as `RegionsEnv` takes it.
        intentions: as `RegionsEnv` takes them.
        max_episode_steps: control steps after which an episode is truncated; -1 for never.
        autoreset_mode: Gymnasium's "NextStep", "SameStep" or "Disabled".
        render_mode: None, or "rgb_array": a picture of each environment.

    Raises:
        InvalidInputError: if an argument is out of range.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: ScenarioLike = "paper-simulation",
        intentions: str = "known",
        max_episode_steps: int = task.MAX_EPISODE_STEPS,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ):
        count("num_envs", num_envs)
        if count("max_episode_steps (-1 for no limit)", max_episode_steps, minimum=-1) == 0:
            raise InvalidInputError("max_episode_steps: got 0, expected >= 1, or -1 for no limit")
        self.autoreset_mode = vector_infos.mode_of(autoreset_mode)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self.num_envs, self.max_episode_steps = num_envs, max_episode_steps
        scenes = SceneSource(scenario, intentions)
        self._declare(exact_model(scenes, num_envs), scenes, render_mode)
        self._family = [self._family] * num_envs
        self._limit = np.inf if max_episode_steps == -1 else max_episode_steps
        self._rngs = [np.random.default_rng() for _ in range(num_envs)]
        self._current: list[Scene | Scenario] = [self.scenario] * num_envs
        is_random = scenes.random_family is not None
        self._batch = RegionsBatch([self.scenario] * num_envs, scenes.hooks, is_random)
        self._has_given_scene = np.zeros(num_envs, dtype=np.bool_)  # a scene from reset's options
        self._ended = np.zeros(num_envs, dtype=np.bool_)
        # the positions (N, 2) [m] after each step; of an endless episode (-1) all are kept
        self._positions: deque[Array] = deque(maxlen=max_episode_steps + 1 or None)
        self.single_action_space = task.action_space(self.scenario.input_set)
        self.single_observation_space = task.observation_space(self._batch.look()[0])
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    @property
    def scenes(self) -> list[Scenario]:
        """The scene of each environment now."""
        return list(map(self._scenes.scenario, self._current))

    @property
    def rom_state(self) -> Array:
        """(N, 4) positions [m] and velocities [m/s]."""
        return self._batch.x.copy()

    @property
    def estimate(self) -> Estimate:
        """The N states and times, which this environment knows exactly."""
        return Estimate(self.rom_state, self.time)

    @property
    def goal(self) -> Array:
        """(N, 2) the points where the references end [m]."""
        return self._batch.goal

    @property
    def barrier_set(self) -> BarrierSet:
        """The barriers of the N scenes."""
        return self._batch.barrier_set

    @property
    def time(self) -> Array:
        """(N,) the time since each environment's reset [s]."""
        return self._batch.time

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return the value that the attribute has in each single environment, as a tuple of N."""
        if name == "scenario":
            return tuple(self.scenes)
        value = getattr(self, name)
        return tuple(value) if name in ("rom_state", "time") else (value,) * self.num_envs

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, object] | None = None,
    ) -> tuple[Array, Info]:
        """Start new episodes in all environments, or in those of ``options["reset_mask"]``.

        Args:
            seed: the seed of environment 0, from which the others count up; or N seeds.
            options: "reset_mask" (N,), and the options of `RegionsEnv.reset`.

        Raises:
            InvalidInputError: if an option is unknown or malformed, or the seeds are not N.
        """
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        scene_options = dict(options or {})
        mask = checks.check_mask(scene_options.pop("reset_mask", everyone), self.num_envs)
        self._scenes.check(scene_options)
        for i, env_seed in enumerate(checks.check_seeds(seed, self.num_envs)):
            if env_seed is not None:
                self._rngs[i], _ = seeding.np_random(env_seed)
        self._draw_scenes(mask, scene_options)
        self._batch.restart(mask)
        self._ended[mask] = False
        self._started = True
        if mask.all():
            self._positions.clear()
        elif self._positions:
            self._positions.pop()
        self._record_positions()
        observation, info = self._batch.reset_infos()
        return observation, vector_infos.only_masked(self._report(info), mask)

    def step(self, actions: Array) -> tuple[Array, Array, Mask, Mask, Info]:
        """Hold the accelerations (N, 2) [m/s²] for one control step.

        Raises:
            InvalidInputError: if the actions are not N pairs of finite numbers, or before the first
                reset.
        """
        u = checks.check_action(actions, (self.num_envs, 2))
        checks.check_started(self._started)
        restarting = self._ended.copy() if self.autoreset_mode is AutoresetMode.NEXT_STEP else None
        if restarting is not None and restarting.any():
            self._draw_scenes(restarting, {})
        step = self._batch.step(u, restarting, change_scenes=self._redraw_intentions)
        observation, reward, terminated, info = step
        truncated = self._batch.steps >= self._limit
        self._ended = terminated | truncated
        infos = self._report(info)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            done, self._ended = self._ended, np.zeros(self.num_envs, dtype=np.bool_)
            self._draw_scenes(done, {})
            self._batch.restart(done)
            observation, fresh = self._batch.reset_infos()
            vector_infos.move_to_final(infos, done, step.observation, fresh)
        self._record_positions()
        return observation, reward, terminated, truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return an (h, w, 3) top-down picture of each environment, or None without a render mode.

        `gymnasium.wrappers.vector.RecordVideo` puts them into a grid.
        """
        if self.render_mode is None:
            return None
        positions, time, steps = np.array(self._positions), self.time, self._batch.steps
        return tuple(
            self._view.draw(scene, float(time[i]), positions[-1 - steps[i] :, i])
            for i, scene in enumerate(self.scenes)
        )

    @cached_property
    def _view(self) -> "TopDownView":
        from hcbf_gym.drawing.top_down import TopDownView  # matplotlib, only for pictures

        return TopDownView(PICTURE_SIDE)

    def _record_positions(self) -> None:
        """Record the positions, of which a picture shows the last ``steps + 1``."""
        if self.render_mode is not None:
            self._positions.append(self._batch.x[:, :2].copy())

    def _draw_scenes(self, mask: Mask, options: Mapping[str, object]) -> None:
        """Put the scene of a reset's options, or the next own ones, into environments (N,)."""
        family = self._scenes.family_name(options)
        self._family = [family if mask[i] else old for i, old in enumerate(self._family)]
        indices = np.flatnonzero(mask).tolist()
        if options:
            self._put_given_scenes(indices, options)
        else:
            self._put_own_scenes(indices)

    def _put_given_scenes(self, indices: list[int], options: Mapping[str, object]) -> None:
        """Put the scene of a reset's options into some environments."""
        if self._scenes.random_family is None and not self._has_given_scene.any():
            self._batch.separate()  # from now on references differ
        for i in indices:
            self._current[i] = scene = self._scenes.next(self._rngs[i], options)
            self._batch.set_scene(i, scene)
        self._has_given_scene[indices] = True

    def _put_own_scenes(self, indices: list[int]) -> None:
        """Put the environment's own scene, or new ones of its family, into some environments."""
        for i in indices:
            if self._has_given_scene[i]:  # a given scene may have another reference and goal radius
                self._current[i] = self.scenario
                self._batch.set_scene(i, self.scenario)
        self._has_given_scene[indices] = False
        family = self._scenes.random_family
        if family is not None:
            scenes = family.draw_scenes([self._rngs[i] for i in indices])
            for k, i in enumerate(indices):
                self._current[i] = scene = scenes.one(k)
                self._batch.set_drawn(i, scene)

    def _redraw_intentions(self) -> None:
        """Let the family redraw hidden velocities, except where an episode has just begun."""
        if not self._scenes.hidden:
            return
        for i, t in enumerate(self.time.tolist()):
            scene = self._current[i]
            if t > 0.0 and self._scenes.redraw_velocities(scene, t, self._rngs[i]):
                assert isinstance(scene, Scene)
                self._batch.set_drawn(i, scene)

    def _report(self, info: dict[str, Array]) -> Info:
        """Return the infos with masks in which all environments report."""
        return vector_infos.with_masks(info, np.ones(self.num_envs, dtype=np.bool_))
