"""HCBF-A1Regions-v0: a Unitree A1 with full physics in the ranked regions."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np
from gymnasium.utils import EzPickle

from hcbf_gym.arrays import Info
from hcbf_gym.certificates import robot_of
from hcbf_gym.envs import a1_plant, task
from hcbf_gym.envs.a1_drive import A1Drive
from hcbf_gym.envs.a1_physics import A1Physics
from hcbf_gym.envs.body import footprint_of
from hcbf_gym.envs.drive import Motion
from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.envs.robot_regions import RobotRegionsEnv
from hcbf_gym.envs.scene_source import SceneSource
from hcbf_gym.estimation import Estimator, sensors
from hcbf_gym.locomotion.controller import LocomotionController, check_friction
from hcbf_gym.locomotion.watch import Watch
from hcbf_gym.robots.mjcf_files import read_by
from hcbf_gym.scenarios import ScenarioLike


class A1RegionsEnv(RobotRegionsEnv[A1Drive]):
    """A Unitree A1 walks through dangerous regions that are ranked by priority.

    ## Description
    The task of `RegionsEnv` with the whole robot: 12 torque-driven joints in MuJoCo. The action is
    the acceleration of a reduced-order model of the trunk; a trot with Raibert footholds, a
    task-space QP and joint impedance, at 500 Hz, turn it into torques. Action, observation (with
    the state that `feedback` names) and rewards are those of `RegionsEnv`, index by index, so that
    a policy trained there acts here unchanged.

    ## Starting State
    At rest at the scenario's start, facing along the reference.

    ## Episode End
    That of `RegionsEnv`, and terminated when the robot falls.

    ## Infos
    Those of `RegionsEnv`, with h of the measured trunk at every physics step in `min_h`; the strict
    speed limit is the last barrier. Also `fallen` (0 or 1), `qp_failures` (task-space QPs
    without a solution so far), `obstacle_force` (k,) the largest contact force with each box
    during the step [N], and `slip` [m/s], `lag` [-] and `lift` [m/s²], by which the robot notices a
    plant that was not declared, see `hcbf_gym.locomotion.watch.Watch`.

    ## Arguments
    * `scenario`: as `RegionsEnv` takes it.
    * `feedback`: "position" closes the loop on the trunk's position and the reduced-order model's
      velocity, which does not oscillate with every step; "measured" on the trunk's position and
      velocity, "rom" on that model's own state.
    * `xml_file`: MJCF of another robot with the A1's joints; None for the package's own.
    * `timestep`: of the physics and the low-level controller [s]; must divide 0.02 s.
    * `gait`: "trot", "walk", or "stand" (which trots on a command or a disturbance).
    * `friction`: µ of the contact forces that the controller plans, which also bounds the filter's
      U and the robot's turns; None is three quarters of the least friction in `randomization`, at
      most 0.6.
    * `terrain`: "flat", or "rough" with blind steps of at most 3 cm.
    * `randomization`: plain dict of `Randomization`'s ranges: floor friction, payload, motor
      strength, delay, sensor noise, start pose. Margins grow with them, and a cap on the speed that
      the plant does not carry is lowered with a `LoweredWarning`; see `a1_plant.Law`.
    * `disturbances`: plain dict of scheduled or random pushes.
    * `estimation`: None closes the loop on the true state; "motion-capture", "lidar", "uwb" or a
      plain dict of `hcbf_gym.estimation.Sensors`' fields gives controller, observation and safety
      filter an estimate. h, rewards, ends and costs are always the truth's.
    * `body`: the part that must stay outside the regions: "point", the trunk's centre as in the
      paper, or "footprint", the whole robot; infos then also have `body_h` and `min_body_h` (m,).
    * `diagnostics`: adds `info["locomotion"]`: stance, foot targets, torques, the QP's status and
      residual.
    * `render_mode`: None, "rgb_array", or "human" (a window).
    """

    def __init__(
        self,
        scenario: ScenarioLike = "paper-simulation",
        feedback: str = "position",
        xml_file: str | None = None,
        timestep: float = task.PHYSICS_DT,
        gait: str = "trot",
        friction: float | None = None,
        terrain: str = "flat",
        randomization: Mapping[str, object] | None = None,
        disturbances: Mapping[str, object] | None = None,
        estimation: str | Mapping[str, object] | None = None,
        body: str = "point",
        diagnostics: bool = False,
        render_mode: str | None = None,
    ):
        EzPickle.__init__(
            self, scenario, feedback, xml_file, timestep, gait, friction, terrain, randomization,
            disturbances, estimation, body, diagnostics, render_mode,
        )  # fmt: skip
        scenes = SceneSource(scenario)
        simulation = A1Physics(
            xml_file,
            timestep=timestep,
            obstacles=scenes.own_scene.obstacles,
            terrain=terrain,
            randomization=randomization,
            disturbances=disturbances,
        )
        footprint = footprint_of(body, simulation)
        reach = 0.0 if footprint is None else footprint.radius(simulation.home_joints)
        declared = Randomization.from_dict(randomization)
        sensor_model = None if estimation is None else sensors.make(estimation)
        derived_friction = a1_plant.derived_friction(declared)
        planned = derived_friction if friction is None else check_friction(friction)
        arguments = {
            "environment": "HCBF-A1Regions-v0",
            "xml_file": xml_file and robot_of(Path(xml_file).stem, read_by(Path(xml_file))),
            "feedback": feedback,
            "timestep": timestep,
            "gait": gait,
            "friction": None if friction is None else round(friction, 9),
            "terrain": terrain,
            "disturbances": disturbances,
            "estimation": sensor_model and asdict(sensor_model),
            "body": body,
        }
        plant_model = a1_plant.plant_model(arguments, scenes.own_scene, declared, planned, reach)
        controller = LocomotionController(
            simulation.robot.xml_file,
            timestep=timestep,
            friction=planned,
            gait=gait,
            max_speed=plant_model.v_max,
        )
        legs, foot_radius = controller.model.legs, simulation.robot.foot_radius
        estimator = sensor_model and Estimator(legs, foot_radius, sensor_model, timestep)
        mass = float(controller.model.bodies.mass.sum())
        bounds = a1_plant.watch_bounds(declared, terrain, estimation is not None, mass)
        watch = Watch(legs, foot_radius, timestep, bounds)
        drive = A1Drive(simulation, controller, estimator, footprint, feedback, watch)
        super().__init__(drive, plant_model, scenes, terrain, render_mode)
        self._diagnostics = diagnostics

    @property
    def controller(self) -> LocomotionController:
        """The controller that makes the robot walk."""
        return self.drive.controller

    def _info_of(self, motion: Motion) -> Info:
        watch = self.drive.watch
        info = super()._info_of(motion) | {
            "qp_failures": np.float64(self.controller.failed),
            "slip": np.float64(watch.slip),
            "lag": np.float64(watch.lag),
            "lift": np.float64(watch.lift),
        }
        if self._diagnostics:
            info["locomotion"] = self.drive.diagnostics()
        return info
