"""HCBF-WalkerRegions-v0: any robot that takes velocities in the ranked regions."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from gymnasium.utils import EzPickle

from hcbf_gym.arrays import Info
from hcbf_gym.barriers import braking
from hcbf_gym.envs.body import footprint_of
from hcbf_gym.envs.drive import Motion
from hcbf_gym.envs.robot_regions import RobotRegionsEnv
from hcbf_gym.envs.scene_source import SceneSource
from hcbf_gym.errors import SafetyWarning, choose, warn_caller
from hcbf_gym.scenarios import ScenarioLike
from hcbf_robots.envs.walker_drive import WalkerDrive
from hcbf_robots.envs.walker_physics import WalkerPhysics
from hcbf_robots.envs.walker_plant import Declared, plant_model
from hcbf_robots.walkers.walker import Walker
from hcbf_robots.walkers.walker_adapter import Adapter
from hcbf_robots.walkers.walker_margins import speed_cap
from hcbf_robots.walkers.walker_parts import HEADINGS


class WalkerRegionsEnv(RobotRegionsEnv[WalkerDrive]):
    """A robot that takes velocities moves through dangerous regions that are ranked by priority.

    ## Description
    The task of `RegionsEnv` with a robot in MuJoCo that has its own controller: a learned
    policy, a vendor's, or wheels. The action is the acceleration of a reduced-order model. The
    model's velocity, turned into the robot's axes, is the controller's command. Action, observation
    (with the robot's position and the model's velocity) and rewards are those of `RegionsEnv`,
    index by index, so that a policy trained there acts here unchanged. For a differential drive the
    action is that of the point before the axle, in axes that turn with the cart: with u = 0 it
    holds its speed and its turning rate (`hcbf_gym.models.axle`).

    ## Starting State
    At rest at the scenario's start, facing along the reference.

    ## Episode End
    Terminated when the robot falls, when its controller returns no finite action of its size, or
    when a "reach" task's goal is within the scenario's `goal_radius`. Truncated after 1000 steps
    (20 s), or as many more as it needs for 24 m at its greatest speed (40 m in a "reach" task).
    `max_episode_steps` of `gym.make` is another limit.

    ## Infos
    Those of `RegionsEnv`, with h of the robot at every physics step in `min_h`; the strict speed
    limit is the last barrier. Also `fallen` (0 or 1), `controller_failed` (0 or 1: the last
    inputs of the actuators were held), `command` (k,) the last command, in the robot's axes
    [m/s, rad/s], and `obstacle_force` (k,) the largest contact force with each box during the step
    [N].

    ## Arguments
    * `robot`: a contract's path or a name, see `hcbf_robots.walkers.walker.Walker`.
    * `scenario`: as `RegionsEnv` takes it.
    * `heading`: "velocity" turns the robot along its velocity, "fixed" holds its heading, "free"
      turns it at `env.unwrapped.drive.adapter.turn` [rad/s], each no faster than its velocity can
      follow; None takes the contract's rule. A differential drive turns as it must.
    * `v_max`: the strict cap on the speed [m/s]; None takes the scenario's, else that of the
      robot's own motors: the greatest forward speed of the contract, and its overshoot.
    * `terrain`: "flat", or "rough" with blind steps of at most 3 cm.
    * `randomization`: plain dict of `Randomization`'s ranges: floor friction, payload, motor
      strength, delay, start pose.
    * `disturbances`: plain dict of scheduled or random pushes.
    * `body`: what must stay outside: "point", the trunk's origin (of a differential drive its
      axle), or "footprint", the whole robot, for which infos also have `body_h` and `min_body_h`
      (m,).
    * `render_mode`: None, "rgb_array", or "human" (a window).
    """

    def __init__(
        self,
        robot: str | Path = "cart",
        scenario: ScenarioLike = "paper-simulation",
        heading: str | None = None,
        v_max: float | None = None,
        terrain: str = "flat",
        randomization: Mapping[str, object] | None = None,
        disturbances: Mapping[str, object] | None = None,
        body: str = "point",
        render_mode: str | None = None,
    ):
        EzPickle.__init__(
            self, robot, scenario, heading, v_max, terrain, randomization, disturbances, body,
            render_mode,
        )  # fmt: skip
        if heading is not None:
            choose("heading", heading, HEADINGS)
        scenes = SceneSource(scenario)
        scene, walker = scenes.own_scene, Walker.load(robot)
        self.contract = walker
        simulation = WalkerPhysics(
            walker,
            obstacles=scene.obstacles,
            terrain=terrain,
            randomization=randomization,
            disturbances=disturbances,
        )
        footprint = footprint_of(body, simulation)
        reach = 0.0
        if footprint is not None:
            reach = walker.body.reach or footprint.radius(simulation.home_joints)
        cap, is_own = speed_cap(walker.command, v_max, scene.v_max)
        declared = Declared(
            heading, terrain, randomization, disturbances, len(scene.obstacles), body, cap
        )
        model = plant_model(walker, declared, scene.input_set, reach, is_own)
        u_max = braking.weakest(model.input_set)
        adapter = Adapter(walker.command, walker.response, u_max, walker.period, heading)
        drive = WalkerDrive(simulation, adapter, footprint, declared.error_factor)
        super().__init__(drive, model, scenes, terrain, render_mode)

    @property
    def fastest(self) -> float:
        """The greatest speed that the rows of the speed limit leave the robot [m/s]."""
        model = self._plant_model
        return float(braking.speed_left(model.v_max, model.uncertainty.speed))

    def _stopped(self) -> bool:
        """Return whether the robot has fallen or its controller has failed; warn of the latter."""
        if self.drive.failed:
            warn_caller(
                f"walker {self.contract.name!r}: its controller {self.contract.policy} gave no "
                "finite action of its size; the last inputs of the actuators hold, and the "
                "episode ends",
                SafetyWarning,
            )
        return self.drive.failed or super()._stopped()

    def _info_of(self, motion: Motion) -> Info:
        return super()._info_of(motion) | {
            "controller_failed": np.float64(self.drive.failed),
            "command": self.drive.command.copy(),
        }
