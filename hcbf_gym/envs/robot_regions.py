"""The base of environments with a simulated robot: their episodes, steps and pictures."""

import math
from typing import Any, Generic, TypeVar

import mujoco
import numpy as np
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.drawing.rendering import OffscreenRenderer, WindowRenderer
from hcbf_gym.drawing.scene_artist import SceneArtist
from hcbf_gym.envs import checks, task
from hcbf_gym.envs.drive import Drive, Motion
from hcbf_gym.envs.plants import PlantModel, SingleRegions
from hcbf_gym.envs.scene import ROUGH_STEP
from hcbf_gym.envs.scene_source import SceneSource
from hcbf_gym.envs.simulation import Simulation
from hcbf_gym.envs.tally import StepTally
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.plant import Estimate
from hcbf_gym.scenarios import Moment, Scenario

D = TypeVar("D", bound=Drive)


class RobotRegionsEnv(SingleRegions, EzPickle, Generic[D]):
    """A simulated robot in the ranked regions; subclasses define the robot and how it moves.

    `SingleRegions` draws each episode's `scenario` and calls `_set_scene` and `_restart`.
    Subclasses extend `_info_of` and `_stopped`.

    Args:
        drive: the robot in its first scene, with its controller.
        plant_model: the model of the robot that a filter assumes.
        scenes: the source of each episode's scene.
        terrain: "flat" or "rough".
        render_mode: None, "rgb_array", or "human".
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 50}  # noqa: RUF012

    def __init__(
        self,
        drive: D,
        plant_model: PlantModel,
        scenes: SceneSource,
        terrain: str,
        render_mode: str | None,
    ):
        self._declare(plant_model, scenes, render_mode)
        scenario = scenes.own_scene
        corners = scenario.input_set.vertices()
        self._u_min, self._u_max = corners.min(axis=0), corners.max(axis=0)
        self._hooks = scenes.hooks
        self._ranks = max(barrier.priority for barrier in scenario.conditions)
        self.artist = SceneArtist(ROUGH_STEP if terrain == "rough" else 0.0)
        self._renderer: OffscreenRenderer | WindowRenderer | None = None
        # the robot is at rest at the start, where `_set_scene` and `_observe` read it
        self.drive = drive
        drive.rest(np.array(scenario.start))
        self._steps, self._estimate, self._fallen = 0, drive.estimate(0.0), False
        self._set_scene(scenario)
        self.action_space = task.action_space(scenario.input_set)
        self.observation_space = task.observation_space(self._observe()[None])

    @property
    def simulation(self) -> Simulation:
        """The plant: the scene with the robot in it."""
        return self.drive.simulation

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model of the scene."""
        return self.simulation.model

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's state of the scene."""
        return self.simulation.data

    @property
    def rom_state(self) -> Array:
        """(4,) position [m] and velocity [m/s] on which the loop is closed."""
        return self._estimate.x.copy()

    @property
    def estimate(self) -> Estimate:
        """The estimate of the robot's state, on which the loop is closed."""
        return self._estimate

    @property
    def truth(self) -> Array:
        """(4,) the trunk's true position [m] and velocity [m/s] in the plane."""
        return self.drive.origin.copy()

    @property
    def time(self) -> float:
        """The time since the reset [s]."""
        return task.CONTROL_DT * self._steps

    def _restart(self) -> tuple[Array, Info]:
        self._steps = 0
        start, yaw = np.array(self.scenario.start), _initial_yaw(self.scenario)
        motion = self.drive.reset(start, yaw, self.barrier_set, self.np_random)
        self.artist.restart()
        h = self.barrier_set.along(motion.path, motion.times)
        self._distance = self._distance_to(self._reference())
        self._estimate, self._fallen = self.drive.estimate(0.0), self.simulation.fallen
        error = np.array([self._distance])
        batch_info = task.reset_info(
            self.scenario.task, h, self.barrier_set, self._ranks, error, self._hooks
        )
        info = self._with_robot(task.without_batch_axis(batch_info), motion)
        if self._hooks.costs is not None:
            moment = self._moment(self._estimate.x, h[0], np.zeros(2))
            info["costs"] = task.own_costs(self._hooks.costs, moment)[0]
        return self._observe(), info

    def step(self, action: Array) -> tuple[Array, float, bool, bool, Info]:
        """Hold the trunk's acceleration u (2,) [m/s²] for one control step."""
        u = np.minimum(np.maximum(checks.check_action(action, (2,)), self._u_min), self._u_max)
        checks.check_started(self._started)
        x_before, distance_before = self._estimate.x, self._distance
        motion = self._advance(u)
        success = self._has_succeeded()
        distances, reference = (distance_before, self._distance), self._reference()
        observation, reward, info = self._tally.result(
            self.barrier_set, motion, self._estimate, reference, u, distances, success
        )
        info = self._with_robot(info, motion)
        if self._hooks.observe is not None:
            observation = self._observe()
        if self._hooks.sees_steps:
            reward = self._apply_hooks(info, self._moment(x_before, info["min_h"], u))
        if self.render_mode == "human":
            self.render()
        terminated = self._stopped() or (success and self.scenario.task == "reach")
        return observation, reward, terminated, False, info

    def _advance(self, u: Array) -> Motion:
        """Move the robot for one control step, and update its estimate and its distance."""
        motion = self.drive.hold(u, self.barrier_set, self.time)
        self._steps += 1
        self._estimate = self.drive.estimate(self.time)
        self._fallen = self.simulation.fallen
        self._distance = self._distance_to(self._reference())
        self.artist.walk(self.drive.truth[:2].tolist())
        return motion

    def _has_succeeded(self) -> bool:
        """Return whether the reference has ended and the robot is at the goal, not fallen."""
        has_ended = self._steps >= len(self._references) - 1
        return has_ended and self._distance <= self.scenario.goal_radius and not self._fallen

    def render(self) -> NDArray[np.uint8] | None:
        """Return an (480, 640, 3) picture, or show the scene in a window."""
        if self.render_mode is None:
            return None
        if self._renderer is None:
            is_offscreen = self.render_mode == "rgb_array"
            renderer_class = OffscreenRenderer if is_offscreen else WindowRenderer
            self._renderer = renderer_class(self.model, self.data)
        return self._renderer.draw(self.artist, self.scenario, self.time)

    def __getstate__(self) -> dict[str, Any]:
        """Return the arguments, from which a copy is made; refuse after the first reset."""
        if self._started:
            raise InvalidInputError(
                f"copy: an environment {self.time:.2f} s into an episode cannot be copied, only "
                "one before its first reset; make another and repeat seed and actions instead"
            )
        return EzPickle.__getstate__(self) | {"_spec": self._spec}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make the environment from its arguments."""
        EzPickle.__setstate__(self, state)
        self._spec = state["_spec"]

    def close(self) -> None:
        """Release the renderer; safe to call twice."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _set_scene(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.barrier_set = BarrierSet([self.barriers], is_placed=True)
        self._references = task.reference_table(scenario)
        self._tally = StepTally(scenario, self.barrier_set.kind.shape[1], self._ranks)
        self._distance = self._distance_to(self._reference())

    def _reference(self) -> Array:
        """Return (6,) the reference's position, velocity and acceleration now."""
        return self._references[min(self._steps, len(self._references) - 1)]

    def _distance_to(self, reference: Array) -> float:
        """Return the distance from a reference (6,) to the point that follows the model [m]."""
        return math.dist(reference[:2].tolist(), self.drive.truth[:2].tolist())

    def _observe(self) -> Array:
        """Return the observation now: (8 + 4 m,), or that of the family's hook."""
        x, reference, sensed = self._estimate.x[None], self._reference()[None], self._sensed()
        return task.observe(self._hooks, x, reference, sensed)[0]

    def _sensed(self) -> Array:
        """Return (1, m, 4) h, its unit gradient and ∂h/∂t of the scene's conditions."""
        _, sensed = self.barrier_set.sense(self._estimate.x[None], np.array([self.time]))
        return sensed[:, : len(self.scenario.conditions)]

    def _moment(self, x_before: Array, min_h: Array, u: Array) -> Moment:
        """Return the argument of a family's hooks for a step, or for a reset."""
        x, reference = self._estimate.x[None], self._reference()[None]
        return Moment(x_before[None], x, reference, self._sensed(), min_h[None], u[None])

    def _apply_hooks(self, info: Info, moment: Moment) -> float:
        """Replace the reward's terms and the costs in the infos; return the reward."""
        terms = {name: np.array([info.pop(name)]) for name in task.REWARD_TERMS[self.scenario.task]}
        terms, costs = task.replaced_by_hooks(self._hooks, moment, terms, info["costs"][None])
        info |= task.without_batch_axis(terms)
        info["costs"] = costs[0]
        return float(sum(term[0] for term in terms.values()))

    def _with_robot(self, info: Info, motion: Motion) -> Info:
        """Return the infos with the robot's, and with its body's costs where it is no point."""
        info = info | self._info_of(motion)
        if motion.body_h is None or motion.least_body_h is None:
            return info
        info["min_body_h"] = motion.least_body_h.copy()
        info["body_h"] = motion.body_h
        min_h = np.minimum(info["min_h"], info["min_body_h"])[None]
        cost, costs = task.costs_of(min_h, self.barrier_set, self._ranks)
        info["cost"], info["costs"] = cost[0], costs[0]
        return info

    def _stopped(self) -> bool:
        """Return whether the robot ends the episode, because it has fallen."""
        return self._fallen

    def _info_of(self, motion: Motion) -> Info:
        """Return the infos that this kind of robot adds."""
        return {"fallen": np.float64(self._fallen), "obstacle_force": motion.obstacle_force}


def _initial_yaw(scenario: Scenario) -> float:
    """Return the heading along the reference's first half metre, or towards the goal."""
    start = np.array(scenario.start)
    for t in np.linspace(0.0, scenario.reference.duration, 50):
        ahead = scenario.reference(t)[0] - start
        if np.linalg.norm(ahead) > 0.5:
            return float(np.arctan2(ahead[1], ahead[0]))
    return 0.0
