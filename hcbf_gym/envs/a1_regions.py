"""HCBF-A1Regions-v0: a Unitree A1 with full physics in the ranked regions."""

import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from hcbf_gym.barriers import Barrier
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.drawing.rendering import OffscreenRenderer, WindowRenderer
from hcbf_gym.drawing.scene_artist import SceneArtist
from hcbf_gym.envs import a1_plant, coverage, task
from hcbf_gym.envs.a1_walker import Walk, Walker
from hcbf_gym.envs.body import Footprint
from hcbf_gym.envs.coverage import Declared
from hcbf_gym.envs.physics import Physics
from hcbf_gym.envs.plain_spec import PlainSpec
from hcbf_gym.envs.plants import plant_of
from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.envs.scene import ROUGH_STEP
from hcbf_gym.envs.scene_source import SceneSource
from hcbf_gym.errors import CoverageWarning, InvalidInputError, choose
from hcbf_gym.estimation import Estimator
from hcbf_gym.locomotion.controller import LocomotionController
from hcbf_gym.locomotion.watch import Watch
from hcbf_gym.models.plant import Coverage, Estimate, Plant
from hcbf_gym.robots import a1
from hcbf_gym.scenarios import Scenario

Array = NDArray[np.float64]


class A1RegionsEnv(PlainSpec, gym.Env[Array, Array], EzPickle):  # pyright: ignore[reportIncompatibleVariableOverride] - see PlainSpec
    """A Unitree A1 walks through dangerous regions that are ranked by priority.

    ## Description
    The task of `RegionsEnv` with the whole robot: 12 torque-driven joints in MuJoCo. The action is
    the acceleration of a reduced-order model of the trunk; a trot with Raibert footholds, a
    task-space QP and joint impedance, at 500 Hz, carry it to the joints.

    ## Action Space
    `Box(low, high, (2,), float32)`, the acceleration u [m/s²] of the trunk in the world, held for
    0.02 s; ±5 m/s² in the paper's scenes. Values outside are clipped; NaN and other shapes are
    refused.

    ## Observation Space
    `Box(-inf, inf, (8 + 4 m,), float64)`, index by index that of `RegionsEnv`, with the state that
    `feedback` names; a policy trained there acts here unchanged.

    ## Rewards
    Those of `RegionsEnv`.

    ## Starting State
    Standing at the scenario's start, facing along the reference.

    ## Episode End
    Terminated when the robot falls, or when a "reach" task's goal is within the scenario's
    `goal_radius`; truncated after 1000 steps (20 s).

    ## Infos
    Those of `RegionsEnv`, with h of the measured trunk at every physics step in `min_h`; the strict
    speed limit is the last barrier. Besides, `fallen` (0 or 1), `qp_failures` (task-space QPs
    without a solution so far), `obstacle_force` (k,) the largest contact force with each box
    during the step [N], and `slip` [m/s], `lag` and `lift` [m/s²], by which the robot notices a
    plant that was not declared, see `hcbf_gym.locomotion.watch.Watch`.

    ## Arguments
    * `scenario`: a name from `hcbf_gym.scenarios.names()`, a plain dict, a path to a JSON file, or
      a `Scenario`.
    * `feedback`: "position" closes the loop on the trunk's position and the reduced-order model's
      velocity, which does not sway with every step; "measured" on the trunk's position and
      velocity, "rom" on that model's own state.
    * `xml_file`: MJCF of another robot with the A1's joints; None for the package's own.
    * `timestep`: of the physics and the low-level controller [s]; must divide 0.02 s.
    * `gait`: "trot", "walk", or "stand" (which trots when something is asked or disturbs).
    * `friction`: µ of the contact forces that the controller plans, and to which the filter's U and
      the robot's turns are fitted; None believes three quarters of the least that `randomization`
      lets the floor have, at most 0.6.
    * `terrain`: "flat", or "rough" with blind steps of at most 3 cm.
    * `randomization`: plain dict of `Randomization`'s ranges: floor friction, payload, motor
      strength, delay, sensor noise, start pose.
    * `disturbances`: plain dict of scheduled or random pushes.
    * `estimation`: None lets the loop see the true state; "motion-capture", "lidar", "uwb" or a
      plain dict of `hcbf_gym.estimation.Sensors`' fields lets controller, observation and safety
      filter see an estimate. h, rewards, ends and costs are always the truth's.
    * `body`: what must stay outside: "point", the trunk's centre as in the paper, or "footprint",
      the whole robot, for which infos then have `body_h` and `min_body_h` (m,) besides.
    * `diagnostics`: adds `info["locomotion"]`: stance, foot targets, torques, the QP's status and
      residual.
    * `render_mode`: None, "rgb_array", or "human" (a window).

    ## Version History
    * v0: first release.
    """

    metadata = {  # noqa: RUF012 - Gymnasium's form
        "render_modes": ["rgb_array", "human"],
        "render_fps": 50,
    }

    def __init__(
        self,
        scenario: str | Path | Mapping[str, Any] | Scenario = "paper-simulation",
        feedback: str = "position",
        xml_file: str | None = None,
        timestep: float = task.PHYSICS_DT,
        gait: str = "trot",
        friction: float | None = None,
        terrain: str = "flat",
        randomization: Mapping[str, Any] | None = None,
        disturbances: Mapping[str, Any] | None = None,
        estimation: str | Mapping[str, Any] | None = None,
        body: str = "point",
        diagnostics: bool = False,
        render_mode: str | None = None,
    ):
        EzPickle.__init__(
            self, scenario, feedback, xml_file, timestep, gait, friction, terrain, randomization,
            disturbances, estimation, body, diagnostics, render_mode,
        )  # fmt: skip
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InvalidInputError(
                f"render_mode: got {render_mode!r}, expected None or one of "
                f"{self.metadata['render_modes']}"
            )
        self.render_mode = render_mode
        self._scenes = SceneSource(scenario)
        self._started, self._steps = False, 0
        self._diagnostics = diagnostics
        self.scenario = self._scenes.own
        robot = a1.XML_FILE if xml_file is None else xml_file
        simulation = Physics(
            robot,
            timestep=timestep,
            obstacles=self.scenario.obstacles,
            terrain=terrain,
            randomization=randomization,
            disturbances=disturbances,
        )
        declared = Randomization.from_dict(randomization)
        believed = a1_plant.believed_friction(declared)
        self._v_max = a1_plant.speed_limit(self.scenario)
        self._outside = coverage.a1(
            Declared(
                own_robot=xml_file is None,
                feedback=feedback,
                timestep=timestep,
                gait=gait,
                friction=friction,
                believed=believed,
                terrain=terrain,
                randomization=declared,
                disturbances=disturbances,
                estimation=estimation,
                body=body,
                boxes=len(self.scenario.obstacles),
                v_max=self._v_max,
            )
        )
        believed = believed if friction is None else friction
        controller = LocomotionController(
            robot, timestep=timestep, friction=believed, gait=gait, max_speed=self._v_max
        )
        self._carried = a1_plant.carried_inputs(self.scenario.input_set, believed)
        choose("body", body, dict.fromkeys(a1_plant.BODIES))
        footprint = None if body == "point" else Footprint(simulation.model, a1.TRUNK)
        radius = 0.0 if footprint is None else footprint.radius(simulation.robot.home_joints)
        self._uncertainty = a1_plant.uncertainty_of(
            declared, terrain, radius, self._carried, self._v_max
        )
        legs, foot_radius = controller.model.legs, simulation.robot.foot_radius
        mass = float(controller.model.bodies.mass.sum())
        self.walker = Walker(
            simulation,
            controller,
            None if estimation is None else Estimator(legs, foot_radius, estimation, timestep),
            footprint,
            feedback,
            Watch(
                legs,
                foot_radius,
                timestep,
                a1_plant.watch_bounds(declared, terrain, estimation is not None, mass),
            ),
        )
        self.action_space: spaces.Space = task.action_space(self.scenario.input_set)
        self.observation_space: spaces.Space = task.observation_space(len(self.scenario.barriers))
        self.artist = SceneArtist(ROUGH_STEP if terrain == "rough" else 0.0)
        self._renderer: OffscreenRenderer | WindowRenderer | None = None
        self._scene_covered = coverage.of_scene(scenario, {})
        self._take_scene(self.scenario)
        if self._outside:
            warnings.warn(
                "HCBF-A1Regions-v0: rank 1 is not promised (covered = 0), as the arguments leave "
                f"what was tested: {'; '.join(self._outside)}",
                CoverageWarning,
                stacklevel=3,
            )

    @property
    def simulation(self) -> Physics:
        """The plant: the scene with the robot in it."""
        return self.walker.simulation

    @property
    def controller(self) -> LocomotionController:
        """What makes the robot walk."""
        return self.walker.controller

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
        return self.estimate.x

    @property
    def barriers(self) -> tuple[Barrier, ...]:
        """The scenario's barriers, then the environment's own, in the order of info["h"]."""
        return task.barriers_of(self.scenario, self._v_max)

    @property
    def plant(self) -> Plant:
        """What a safety filter must know."""
        return plant_of(self, self._carried, self._uncertainty, on_alarm="brake")

    @property
    def covered(self) -> Coverage:
        """Whether the promise was tested for these arguments and this episode's scenes."""
        return Coverage.OUTSIDE if self._outside else self._scene_covered

    @property
    def estimate(self) -> Estimate:
        """What is known of the robot: the state on which the loop is closed."""
        return self.walker.estimate(self.time)

    @property
    def truth(self) -> Array:
        """(4,) the trunk's true position [m] and velocity [m/s] in the plane."""
        return self.walker.truth.copy()

    @property
    def goal(self) -> Array:
        """(2,) where the reference ends [m]."""
        return self.scenario.goal

    @property
    def time(self) -> float:
        """Time since the reset [s]."""
        return task.CONTROL_DT * self._steps

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start a new episode; a seed decides everything that follows.

        Args:
            seed: of the scenes and the randomisation; None goes on.
            options: "scenario" and "start" (2,) [m] of this episode alone.

        Raises:
            InvalidInputError: if an option is unknown, or the scene is of another kind.
        """
        given = self._scenes.check(options)
        super().reset(seed=seed)
        scene = self._scenes.next(self.np_random, given)
        if scene is not self.scenario:
            self._take_scene(scene)
        self._scene_covered = coverage.of_scene(self._scenes.source, given)
        self._steps, self._started = 0, True
        start, yaw = np.array(self.scenario.start), _initial_yaw(self.scenario)
        walk = self.walker.reset(start, yaw, self.barrier_set, self.np_random)
        self.artist.restart()
        h = self.barrier_set.along(walk.path, walk.times)
        info = task.first(task.reset_info(self.scenario.task, h, self._error()))
        return self._observe(), info | self._info_of(walk)

    def change_scene(self, scenario: Scenario) -> None:
        """Move, resize or rank regions anew in the midst of an episode.

        Raises:
            InvalidInputError: if the scene is of another kind than the environment's.
        """
        self._scenes.check({"scenario": scenario})
        self._scene_covered = Coverage.SCENE
        self._set_scene(scenario)

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold the trunk's acceleration u (2,) [m/s²] for one control step."""
        u = task.check_action(action, (2,)).clip(*self._bounds)
        task.check_started(self._started)
        distance_before = self._error()
        walk = self.walker.hold(u, self.barrier_set, self.time)
        self._steps += 1
        self.artist.walk(self.walker.truth[:2])
        h = self.barrier_set.along(walk.path, walk.times)

        distance, fallen = self._error(), self.simulation.fallen
        at_end = self._steps >= len(self._references) - 1
        success = (distance <= self.scenario.goal_radius) & (at_end and not fallen)
        reached = success & (self.scenario.task == "reach")
        terms = task.reward_terms(self.scenario.task, distance_before, distance, reached, u[None])
        least = h.min(axis=0, keepdims=True)
        info = task.first(task.step_info(h[-1:], least, distance, success) | terms)
        info |= self._info_of(walk)
        if self.render_mode == "human":
            self.render()
        reward = float(sum(term[0] for term in terms.values()))
        return self._observe(), reward, fallen or bool(reached[0]), False, info

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
                f"copy: got an environment {self.time:.2f} s into an episode, expected one before "
                "its first reset; make another and repeat seed and actions instead"
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
        self.barrier_set = BarrierSet([self.barriers])
        self._references = task.reference_table(scenario)

    def _take_scene(self, scenario: Scenario) -> None:
        self._set_scene(scenario)
        corners = scenario.input_set.vertices()
        self._bounds = corners.min(axis=0), corners.max(axis=0)
        self._steps = 0
        self.walker.rest(np.array(scenario.start))

    def _info_of(self, walk: Walk) -> dict[str, Any]:
        """Return what infos say of the robot besides."""
        watch = self.walker.watch
        info: dict[str, Any] = {
            "fallen": np.float64(self.simulation.fallen),
            "qp_failures": np.float64(self.controller.failed),
            "obstacle_force": walk.obstacle_force,
            "slip": np.float64(watch.slip),
            "lag": np.float64(watch.lag),
            "lift": np.float64(watch.lift),
        }
        if walk.body_h is not None and walk.least_body_h is not None:
            info |= {"body_h": walk.body_h, "min_body_h": walk.least_body_h.copy()}
        if self._diagnostics:
            info["locomotion"] = self.walker.diagnostics()
        return info

    def _reference(self) -> Array:
        return self._references[None, min(self._steps, len(self._references) - 1)]

    def _error(self) -> Array:
        gap = self._reference()[0, :2] - self.walker.truth[:2]
        return np.array([math.hypot(*gap.tolist())])

    def _observe(self) -> Array:
        x = self.rom_state[None]
        _, sensed = self.barrier_set.sense(x, np.array([self.time]))
        return task.observe(x, self._reference(), sensed, len(self.scenario.barriers))[0]


def _initial_yaw(scenario: Scenario) -> float:
    """Return the heading along the reference's first half metre, or towards the goal."""
    start = np.array(scenario.start)
    for t in np.linspace(0.0, scenario.reference.duration, 50):
        ahead = scenario.reference(t)[0] - start
        if np.linalg.norm(ahead) > 0.5:
            return float(np.arctan2(ahead[1], ahead[0]))
    return 0.0
