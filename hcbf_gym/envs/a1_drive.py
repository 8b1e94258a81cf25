"""An A1 that walks: its tick is controller, physics and estimator."""

import numpy as np

from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.a1_physics import BASE, A1Physics
from hcbf_gym.envs.body import Footprint
from hcbf_gym.envs.drive import Drive, Motion
from hcbf_gym.errors import choose
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


class A1Drive(Drive[A1Physics]):
    """An A1 in its scene, with the controller that makes it walk.

    Args:
        simulation: the scene.
        controller: what turns u into torques.
        estimator: what gives the controller and the filter the robot's state; None is the truth.
        footprint: as `Drive` takes it.
        feedback: on which state the loop is closed, a name of `FEEDBACK`.
        watch: notices a plant that is not the one which was declared.

    Raises:
        UnknownNameError: if there is no such feedback.
        InvalidInputError: if the simulation's tick does not divide the control step.
    """

    def __init__(
        self,
        simulation: A1Physics,
        controller: LocomotionController,
        estimator: Estimator | None,
        footprint: Footprint | None,
        feedback: str,
        watch: Watch,
    ):
        choose("feedback", feedback, FEEDBACK)
        self.controller, self.watch, self.feedback = controller, watch, feedback
        self._estimator = estimator
        self._u: Array = np.zeros(2)
        super().__init__(simulation, footprint, look_ahead=0.0)

    def rest(self, position: Array) -> None:
        """Count as standing at a position (2,) [m], before the first reset."""
        super().rest(position)
        self._known: Array | None = None  # (41,) the robot's state as estimated

    def _begin(self, rng: np.random.Generator) -> None:
        """Begin an episode: controller, estimator and watch forget the one before."""
        if self._estimator is not None:
            # errors of the sensors come from a stream of their own: the plant stays the same
            (errors,) = rng.spawn(1)
            self._known = self._estimator.reset(self.simulation.truth, errors)
        self.controller.reset(self.simulation.state(self._known))
        self.watch.reset()

    def hold(self, u: Array, barriers: BarrierSet, time: float) -> Motion:
        """Hold the trunk's acceleration u (2,) [m/s²] for one control step."""
        self._u = u
        motion = self._run(barriers, time)
        self.watch.judge(self.controller.lift)
        return motion

    def _tick(self, k: int) -> bool:
        simulation, controller = self.simulation, self.controller
        state = simulation.state(self._known)
        torque = controller.step(state, self._u)
        self.watch.tick(state.vector, torque, controller.stance)
        simulation.step(torque)
        if simulation.diverged:
            return False
        if self._estimator is not None:
            self._known = self._estimator.tick(simulation.truth)
        return True

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

    def diagnostics(self) -> Info:
        """Return the controller's record as NumPy's float64, as infos carry them."""
        return {
            name: np.asarray(value, dtype=np.float64) if np.ndim(value) else np.float64(value)
            for name, value in self.controller.diagnostics._asdict().items()
        }
