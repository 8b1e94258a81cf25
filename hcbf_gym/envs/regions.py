"""HCBF-Regions-v0: the reduced-order robot alone in the ranked regions."""

from collections import deque
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs import checks, task
from hcbf_gym.envs.plants import SingleRegions, exact_model
from hcbf_gym.envs.regions_batch import RegionsBatch
from hcbf_gym.envs.scene_source import SceneSource
from hcbf_gym.models.plant import Estimate
from hcbf_gym.scenarios import Scenario, ScenarioLike

if TYPE_CHECKING:
    from hcbf_gym.drawing.top_down import TopDownView

PATH_POINTS = 3000  # last positions that a picture shows, which bounds the memory of a path


class RegionsEnv(SingleRegions):
    """The reduced-order robot walks through dangerous regions that are ranked by priority.

    ## Description
    A double integrator ``p̈ = u`` in the plane follows a reference (task "track") or runs to a goal
    (task "reach") among regions that it should not enter. The regions carry priorities: 1 is
    strict, regions of higher numbers may be entered as far as the lower ones leave no other choice.
    Nothing in the environment enforces that: wrap it in `hcbf_gym.wrappers.SafetyFilter`.

    ## Action Space
    `Box(low, high, (2,), float32)`, the acceleration u [m/s²] held for 0.02 s; ±5 m/s² in the
    paper's scenes. Values outside are clipped; NaN and other shapes are refused.

    ## Observation Space
    `Box(-inf, inf, (8 + 4 m,), float64)` for a scenario of m barriers:

    | index | meaning | unit |
    |---|---|---|
    | 0, 1 | position error, p_ref − p | m |
    | 2, 3 | velocity error, v_ref − v | m/s |
    | 4, 5 | velocity v | m/s |
    | 6, 7 | acceleration of the reference | m/s² |
    | 8 + 4k | value h_k of barrier k | m |
    | 9 + 4k, 10 + 4k | its unit gradient ∇h_k/‖∇h_k‖ | - |
    | 11 + 4k | its own motion ∂h_k/∂t | m/s |

    In a "reach" task p_ref is the goal, v_ref and its acceleration are zero.

    ## Rewards
    The sum of the terms in info. track: `reward_tracking` = −‖p_ref − p‖. reach:
    `reward_progress`, the distance to the goal gained [m], and `reward_goal` = 10 when it is
    reached. Both: `reward_effort` = −10⁻³‖u‖². Safety is not in the reward but in `info["cost"]`.

    ## Starting State
    At rest at the scenario's start. A family such as `scenario="random"` draws another scene at
    every reset, and may have its own observation, reward and costs.
    ``reset(options={"scenario": …, "start": (x, y)})`` sets another scene of the same kind, or
    another start, for one episode.

    ## Episode End
    Terminated when a "reach" task's goal is within the scenario's `goal_radius`; truncated after
    1000 steps (20 s).

    ## Infos
    `h` (m,) at the step's end, `min_h` (m,) the least over its ten substeps, `violation` (m,)
    max(0, −h), `cost` 1 where a condition of rank 1 was below zero in the step, else 0, `costs`
    (R,) the greatest depth in each rank [m], 0 where a rank is absent; R is the last rank of the
    scene at construction. `tracking_error` ‖p_ref − p‖ [m], `is_success` (1 where the robot is
    within `goal_radius` of the goal and the reference has ended), and the reward's terms. A
    speed limit that the scenario sets comes after its own barriers. A reset reports the same, with
    `is_success` and the terms zero.

    ## Arguments
    * `scenario`: a name from `hcbf_gym.scenarios.names()`, a plain dict, a path to a JSON file, or
      a `Scenario`.
    * `intentions`: "hidden" lets regions of a family such as `random-crossing` change their
      velocities within an episode; "known" does not.
    * `render_mode`: None or "rgb_array", a top-down picture.
    """

    def __init__(
        self,
        scenario: ScenarioLike = "paper-simulation",
        intentions: str = "known",
        render_mode: str | None = None,
    ):
        scenes = SceneSource(scenario, intentions)
        self._declare(exact_model(scenes), scenes, render_mode)
        self._batch = RegionsBatch([self.scenario], scenes.hooks)
        self.action_space = task.action_space(self.scenario.input_set)
        self.observation_space = task.observation_space(self._batch.look()[0])
        self._path: deque[Array] = deque(maxlen=PATH_POINTS)

    @property
    def rom_state(self) -> Array:
        """(4,) position [m] and velocity [m/s]."""
        return self._batch.x[0].copy()

    truth = rom_state

    @property
    def estimate(self) -> Estimate:
        """The robot's state and time, which this environment knows exactly."""
        batch = self._batch
        return Estimate(batch.x[0].copy(), batch.steps[0] * task.CONTROL_DT)

    @property
    def barrier_set(self) -> BarrierSet:
        """The scenario's barriers, then the environment's own, as one scene."""
        return self._batch.barrier_set

    @property
    def time(self) -> float:
        """The time since the reset [s]."""
        return float(self._batch.time[0])

    def step(self, action: Array) -> tuple[Array, float, bool, bool, Info]:
        """Hold the acceleration u (2,) [m/s²] for one control step.

        Raises:
            InvalidInputError: if the action is no pair of finite numbers, or there was no reset.
        """
        u = checks.check_action(action, (2,))
        checks.check_started(self._started)
        step = self._batch.step(u[None], change_scenes=self._redraw_intentions)
        self._path.append(self.rom_state[:2])
        reward, terminated = float(step.reward[0]), bool(step.reached[0])
        return step.observation[0], reward, terminated, False, task.without_batch_axis(step.info)

    def render(self) -> NDArray[np.uint8] | None:
        """Return an (h, w, 3) top-down picture, or None without a render mode."""
        if self.render_mode is None:
            return None
        return self._view.draw(self.scenario, self.time, np.array(self._path))

    @cached_property
    def _view(self) -> "TopDownView":
        from hcbf_gym.drawing.top_down import TopDownView  # matplotlib, only for pictures

        return TopDownView()

    def _set_scene(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self._batch.set_scene(0, scenario)

    def _redraw_intentions(self) -> None:
        """Let the family redraw the regions' velocities, where intentions are hidden."""
        scene = self._scenes.drawn_scene
        if self._scenes.redraw_velocities(scene, self.time, self.np_random):
            assert scene is not None
            self.scenario = self._scenes.scenario(scene)
            self._batch.set_drawn(0, scene)

    def _restart(self) -> tuple[Array, Info]:
        self._batch.restart(np.ones(1, dtype=np.bool_))
        self._path.clear()
        self._path.append(self.rom_state[:2])
        observation, info = self._batch.reset_infos()
        return observation[0], task.without_batch_axis(info)
