"""What the environments with a simulated robot share: episodes, scenes, steps and pictures."""

import math
from typing import Any, Generic, TypeVar

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers import Barrier
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.certificates import Judged
from hcbf_gym.drawing.rendering import OffscreenRenderer, WindowRenderer
from hcbf_gym.drawing.scene_artist import SceneArtist
from hcbf_gym.envs import task
from hcbf_gym.envs.drive import Drive, Motion
from hcbf_gym.envs.plain_spec import PlainSpec
from hcbf_gym.envs.plants import PlantModel, plant_of, warn_of
from hcbf_gym.envs.scene import ROUGH_STEP
from hcbf_gym.envs.scene_source import SceneSource
from hcbf_gym.envs.simulation import Simulation
from hcbf_gym.envs.tally import StepTally
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.plant import Estimate, Plant
from hcbf_gym.scenarios import Moment, Scenario

D = TypeVar("D", bound=Drive)


class RobotRegionsEnv(  # pyright: ignore[reportIncompatibleVariableOverride] - see PlainSpec
    PlainSpec, gym.Env[Array, Array], EzPickle, Generic[D]
):
    """A simulated robot in the ranked regions; what it is and how it moves, a subclass says.

    Args:
        drive: the robot in its first scene, with what steers it.
        known: what a filter takes for true of it.
        scenes: where each episode's scene comes from.
        terrain: "flat" or "rough".
        render_mode: None, "rgb_array", or "human".

    Raises:
        InvalidInputError: if there is no such mode.
    """

    metadata = {  # noqa: RUF012 - Gymnasium's form
        "render_modes": ["rgb_array", "human"],
        "render_fps": 50,
    }

    def __init__(
        self,
        drive: D,
        known: PlantModel,
        scenes: SceneSource,
        terrain: str,
        render_mode: str | None,
    ):
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InvalidInputError(
                f"render_mode: got {render_mode!r}, expected None or one of "
                f"{self.metadata['render_modes']}"
            )
        self.render_mode, self.drive, self._known, self._scenes = render_mode, drive, known, scenes
        self._started, self._steps = False, 0
        own = scenes.own
        self.action_space: spaces.Space = task.action_space(own.input_set)
        self.artist = SceneArtist(ROUGH_STEP if terrain == "rough" else 0.0)
        self._renderer: OffscreenRenderer | WindowRenderer | None = None
        self._family, self._hooks = scenes.family({}), scenes.hooks
        self._ranks = max(barrier.priority for barrier in own.conditions)
        self._take_scene(own)
        self.observation_space: spaces.Space = task.observation_space(self._observe()[None])
        warn_of(known.declared["environment"], known.nearest.judged)

    @property
    def plant(self) -> Plant:
        """What a safety filter must know."""
        known = self._known
        return plant_of(known.input_set, known.uncertainty, "brake", known.axle, known.braking)

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
    def barriers(self) -> tuple[Barrier, ...]:
        """The scenario's barriers, then the environment's own, in the order of info["h"]."""
        return task.barriers_of(self.scenario, self._known.v_max)

    @property
    def judged(self) -> Judged:
        """Whether the promise was tested for these arguments and this episode's scenes."""
        return self._known.nearest.again(self.declared)

    @property
    def declared(self) -> dict[str, Any]:
        """What tells this plant from others, as certificates compare it."""
        return self._known.declared | {"scene": self._family}

    @property
    def estimate(self) -> Estimate:
        """What is known of the robot: the state on which the loop is closed."""
        return self._estimate

    @property
    def truth(self) -> Array:
        """(4,) the trunk's true position [m] and velocity [m/s] in the plane."""
        return self.drive.origin.copy()

    @property
    def goal(self) -> Array:
        """(2,) where the reference ends [m]."""
        return self.scenario.goal

    @property
    def time(self) -> float:
        """Time since the reset [s]."""
        return task.CONTROL_DT * self._steps

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[Array, Info]:
        """Start a new episode; a seed decides everything that follows.

        Args:
            seed: of the scenes and the randomisation; None goes on.
            options: "scenario" and "start" (2,) [m] of this episode alone.

        Raises:
            InvalidInputError: if an option is unknown, or the scene is of another kind.
        """
        given = self._scenes.check(options)
        super().reset(seed=task.check_seed(seed))
        scene = self._scenes.next(self.np_random, given)
        if scene is not self.scenario:
            self._take_scene(scene)
        self._family = self._scenes.family(given)
        self._steps, self._started = 0, True
        start, yaw = np.array(self.scenario.start), _initial_yaw(self.scenario)
        motion = self.drive.reset(start, yaw, self.barrier_set, self.np_random)
        self.artist.restart()
        h = self.barrier_set.along(motion.path, motion.times)
        self._distance = _distance(self._reference(), self.drive.truth[:2].tolist())
        self._estimate, self._fallen = self.drive.estimate(0.0), self.simulation.fallen
        ranked = task.Ranked.of(self.barrier_set, self._ranks)
        distance = np.array([self._distance])
        given = task.reset_info(self.scenario.task, h, ranked, distance, self._hooks)
        info = self._with_body(task.first(given) | self._info_of(motion))
        if self._hooks.costs is not None:
            x = self._estimate.x
            costs = self._hooks.costs(self._moment(x, h[0], np.zeros(2)))
            info["costs"] = task.answer("costs", costs, 1, 2)[0]
        return self._observe(), info

    def change_scene(self, scenario: Scenario) -> None:
        """Move, resize or rank regions anew in the midst of an episode.

        Raises:
            InvalidInputError: if the scene is of another kind than the environment's.
        """
        self._scenes.check({"scenario": scenario})
        self._family = None
        self._set_scene(scenario)
        self._distance = _distance(self._reference(), self.drive.truth[:2].tolist())

    def step(self, action: Array) -> tuple[Array, float, bool, bool, Info]:
        """Hold the trunk's acceleration u (2,) [m/s²] for one control step."""
        low, high = self._bounds
        u = np.minimum(np.maximum(task.check_action(action, (2,)), low), high)
        task.check_started(self._started)
        drive, scene, known = self.drive, self.barrier_set, self._estimate
        motion = drive.hold(u, scene, self.time)
        self._steps += 1
        self._estimate = drive.estimate(self.time)
        self._fallen = drive.simulation.fallen
        reference, position = self._reference(), drive.truth[:2].tolist()
        self.artist.walk(position)

        before = self._distance
        distance = self._distance = _distance(reference, position)
        at_end = self._steps >= len(self._references) - 1
        success = at_end and distance <= self.scenario.goal_radius and not self._fallen
        counted = self._tally.count(
            scene, motion, self._estimate, reference, u, (before, distance), success
        )
        info = self._with_body(counted.info | self._info_of(motion))
        observation, reward, hooks = counted.observation, counted.reward, self._hooks
        if hooks.observe is not None:
            observation = self._observe()
        if hooks.sees_steps:
            reward = self._judge(info, self._moment(known.x, info["min_h"], u))
        if self.render_mode == "human":
            self.render()
        ended = self._stopped() or (success and self.scenario.task == "reach")
        return observation, reward, ended, False, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return an (480, 640, 3) picture, or show the scene in a window."""
        if self.render_mode is None:
            return None
        simulation = self.simulation
        if self._renderer is None:
            self._renderer = (
                OffscreenRenderer(simulation.model)
                if self.render_mode == "rgb_array"
                else WindowRenderer(simulation.model, simulation.data)
            )
        if isinstance(self._renderer, OffscreenRenderer):
            return self._renderer.frame(simulation.data, self.artist, self.scenario, self.time)
        self._renderer.show(self.artist, self.scenario, self.time)
        return None

    def __getstate__(self) -> dict[str, Any]:
        """Return what makes an equal environment anew: before the first reset, nothing else counts.

        Raises:
            InvalidInputError: after it, as a copy would stand at the start of another episode.
        """
        if self._started:
            raise InvalidInputError(
                f"copy: an environment {self.time:.2f} s into an episode cannot be copied, only "
                "one before its first reset; make another and repeat seed and actions instead"
            )
        return EzPickle.__getstate__(self) | {"_spec": self._spec}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make the environment anew from its arguments."""
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

    def _take_scene(self, scenario: Scenario) -> None:
        self._set_scene(scenario)
        corners = scenario.input_set.vertices()
        self._bounds = corners.min(axis=0), corners.max(axis=0)
        self._steps = 0
        self.drive.rest(np.array(scenario.start))
        self._estimate = self.drive.estimate(0.0)
        self._distance = _distance(self._reference(), self.drive.truth[:2].tolist())

    def _reference(self) -> Array:
        return self._references[min(self._steps, len(self._references) - 1)]

    def _observe(self) -> Array:
        x, reference, sensed = self._estimate.x[None], self._reference()[None], self._sensed()
        if self._hooks.observe is not None:
            return task.observed(self._hooks, x, reference, sensed)[0]
        return task.observe(x, reference, sensed)[0]

    def _sensed(self) -> Array:
        """Return (1, m, 4) what a policy sees of the scene's conditions."""
        _, sensed = self.barrier_set.sense(self._estimate.x[None], np.array([self.time]))
        return sensed[:, : len(self.scenario.conditions)]

    def _moment(self, before: Array, min_h: Array, u: Array) -> Moment:
        """Return what hooks see of a step, or of a reset."""
        x, reference = self._estimate.x[None], self._reference()[None]
        return Moment(before[None], x, reference, self._sensed(), min_h[None], u[None])

    def _judge(self, info: Info, moment: Moment) -> float:
        """Put the reward and the costs of a family's own into infos; return the reward."""
        terms = {name: np.array([info.pop(name)]) for name in task.REWARD_TERMS[self.scenario.task]}
        terms, costs = task.judged(self._hooks, moment, terms, info["costs"][None])
        info |= task.first(terms)
        info["costs"] = costs[0]
        return float(sum(term[0] for term in terms.values()))

    def _with_body(self, info: Info) -> Info:
        """Return the infos with the costs of the whole robot, where it must stay outside."""
        if "min_body_h" in info:
            least = np.minimum(info["min_h"], info["min_body_h"])
            ranked = task.Ranked.of(self.barrier_set, self._ranks)
            cost, costs = task.costs_of(least[None], *ranked)
            info["cost"], info["costs"] = cost[0], costs[0]
        return info

    def _stopped(self) -> bool:
        """Return whether the robot cannot go on."""
        return self._fallen

    def _info_of(self, motion: Motion) -> Info:
        """Return what infos say of the robot besides."""
        info: Info = {
            "fallen": np.float64(self._fallen),
            "obstacle_force": motion.obstacle_force,
        }
        if motion.body_h is not None and motion.least_body_h is not None:
            info["body_h"], info["min_body_h"] = motion.body_h, motion.least_body_h.copy()
        return info


def _distance(reference: Array, position: list[float]) -> float:
    """Return how far a position (2,) is from the reference's [m]."""
    return math.dist(reference[:2].tolist(), position)


def _initial_yaw(scenario: Scenario) -> float:
    """Return the heading along the reference's first half metre, or towards the goal."""
    start = np.array(scenario.start)
    for t in np.linspace(0.0, scenario.reference.duration, 50):
        ahead = scenario.reference(t)[0] - start
        if np.linalg.norm(ahead) > 0.5:
            return float(np.arctan2(ahead[1], ahead[0]))
    return 0.0
