"""The robot that walks: physics, controller and estimator, run together for one control step."""

from typing import Any, NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs import task
from hcbf_gym.envs.body import Footprint
from hcbf_gym.envs.physics import BASE, Physics
from hcbf_gym.errors import InvalidInputError, choose
from hcbf_gym.estimation import Estimator
from hcbf_gym.locomotion.controller import LocomotionController
from hcbf_gym.locomotion.watch import Fault, Watch
from hcbf_gym.models.plant import Estimate, Reason

FEEDBACK = {
    "measured": "position and velocity of the trunk",
    "position": "position of the trunk, velocity of the reduced-order model",
    "rom": "position and velocity of the reduced-order model",
}
"""On which state the loop is closed."""


ALARMS = {
    Fault.NONE: None,
    Fault.SLIP: Reason.SLIP,
    Fault.LAG: Reason.LAG,
    Fault.LIFT: Reason.LIFT,
}
"""What a filter calls what the watch finds."""


class Walk(NamedTuple):
    """What happened from one action to the next.

    Attributes:
        path: (k, 4) planar position [m] and velocity [m/s] of the trunk after every tick.
        times: (k,) of them since the reset [s].
        obstacle_force: (b,) the largest force with each box [N].
        body_h: (m,) of the whole robot at the end [m]; None where it counts as a point.
        least_body_h: (m,) the least of it.
    """

    path: Array
    times: Array
    obstacle_force: Array
    body_h: Array | None = None
    least_body_h: Array | None = None


class Walker:
    """The robot in its scene, with what steers it.

    Args:
        simulation: the plant.
        controller: what turns u into torques.
        estimator: what tells the controller and the filter where the robot is; None is the truth.
        footprint: measures the whole robot's distance to the regions; None for a point.
        feedback: on which state the loop is closed, a name of `FEEDBACK`.
        watch: notices a plant that is not the one which was declared.

    Raises:
        UnknownNameError: if there is no such feedback.
        InvalidInputError: if the simulation's tick does not divide the control step.
    """

    def __init__(
        self,
        simulation: Physics,
        controller: LocomotionController,
        estimator: Estimator | None,
        footprint: Footprint | None,
        feedback: str,
        watch: Watch,
    ):
        choose("feedback", feedback, FEEDBACK)
        self.simulation, self.controller, self.watch = simulation, controller, watch
        self.feedback = feedback
        self._estimator, self._footprint = estimator, footprint
        timestep = simulation.model.opt.timestep
        self._ticks: Array = np.arange(1, ticks_of(timestep) + 1) * np.float64(timestep)
        self.rest(np.zeros(2))

    def rest(self, position: Array) -> None:
        """Count as standing at a position (2,) [m], before the first reset."""
        self.truth: Array = np.array([*position, 0.0, 0.0])
        self._known: Array | None = None  # (41,) the robot's state as estimated

    def reset(
        self, position: Array, yaw: float, barriers: BarrierSet, rng: np.random.Generator
    ) -> Walk:
        """Put the robot at rest at a position (2,) [m] and heading [rad]; nothing has happened."""
        self.simulation.reset(position, yaw, rng)
        if self._estimator is not None:
            # errors of the sensors come from a stream of their own: the plant stays the same
            (errors,) = rng.spawn(1)
            self._known = self._estimator.reset(self.simulation.truth, errors)
        self.controller.reset(self.simulation.state(self._known))
        self.watch.reset()
        self.truth = self.simulation.base_state
        body = self._body_h(barriers, 0.0)
        forces = np.zeros_like(self.simulation.obstacle_forces())
        return Walk(self.truth[None], np.zeros(1), forces, body, body)

    def hold(self, u: Array, barriers: BarrierSet, time: float) -> Walk:
        """Hold the trunk's acceleration u (2,) [m/s²] for one control step.

        Args:
            u: (2,) [m/s²].
            barriers: from which the body's distance is measured.
            time: at which it begins, since the reset [s].
        """
        simulation, controller, path, bodies = self.simulation, self.controller, [], []
        forces = [np.zeros_like(simulation.obstacle_forces())]
        for tick in self._ticks:
            state = simulation.state(self._known)
            torque = controller.step(state, u)
            self.watch.tick(state.vector, torque, controller.stance)
            simulation.step(torque)
            if simulation.diverged:  # the last finite state stands
                break
            if self._estimator is not None:
                self._known = self._estimator.tick(simulation.truth)
            path.append(simulation.truth)
            bodies.append(self._body_h(barriers, time + tick))
            forces.append(simulation.obstacle_forces())
        self.watch.judge(controller.lift)
        walked = np.array(path).take(BASE, axis=1) if path else self.truth[None]
        self.truth = walked[-1]
        times = time + self._ticks[: len(walked)]
        force = np.maximum.reduce(forces)
        if self._footprint is None:
            return Walk(walked, times, force)
        bodies = bodies or [self._body_h(barriers, time)]
        return Walk(walked, times, force, bodies[-1], np.minimum.reduce(bodies))

    def estimate(self, time: float) -> Estimate:
        """Return what is known of the robot: the state on which the loop is closed.

        Args:
            time: since the reset [s].
        """
        body = self.truth if self._known is None else self._known[BASE]
        reference = self.controller.reference
        model = np.concatenate([reference.position, reference.velocity])
        x = {
            "measured": body,
            "position": np.concatenate([body[:2], model[2:]]),
            "rom": model,
        }[self.feedback]
        covariance, yaw = None, self.simulation.yaw
        if self._estimator is not None:
            known = self._estimator.estimate
            covariance, yaw = known.covariance, known.yaw
        fault = ALARMS[self.watch.fault]
        return Estimate(x, time, covariance, model, body - model, np.float64(yaw), fault=fault)

    def diagnostics(self) -> dict[str, Any]:
        """Return the controller's record as NumPy's float64, as infos carry them."""
        return {
            name: np.asarray(value, dtype=np.float64) if np.ndim(value) else np.float64(value)
            for name, value in self.controller.diagnostics._asdict().items()
        }

    def _body_h(self, barriers: BarrierSet, time: float) -> Any:
        if self._footprint is None:
            return None
        return self._footprint.h(self.simulation.data, barriers, time)


def ticks_of(timestep: float) -> int:
    """Return how many ticks of this length [s] a control step has.

    Raises:
        InvalidInputError: if they do not divide it.
    """
    ticks = round(task.CONTROL_DT / timestep)
    if ticks < 1 or abs(ticks * timestep - task.CONTROL_DT) > 1e-9:
        raise InvalidInputError(
            f"timestep: got {timestep} s, expected one that divides {task.CONTROL_DT} s"
        )
    return ticks
