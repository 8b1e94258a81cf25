"""The A1 with its controller: one tick runs controller, physics and estimator."""

import numpy as np

from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.a1_physics import BASE, A1Physics
from hcbf_gym.envs.body import Footprint
from hcbf_gym.envs.drive import Drive, Motion
from hcbf_gym.errors import choose
from hcbf_gym.estimation import Estimator
from hcbf_gym.locomotion.controller import LocomotionController
from hcbf_gym.locomotion.watch import Fault, Watch
from hcbf_gym.models.plant import Estimate

FEEDBACK = ("measured", "position", "rom")
"""The states on which the loop can be closed; see `A1RegionsEnv`."""

REASON_OF_FAULT = {
    Fault.NONE: None,
    Fault.SLIP: Reason.SLIP,
    Fault.LAG: Reason.LAG,
    Fault.LIFT: Reason.LIFT,
}
"""The reason with which a filter reacts to each fault of the watch."""


class A1Drive(Drive[A1Physics]):
    """An A1 in its scene, with the controller that makes it walk.

    Args:
        simulation: the scene.
        controller: turns u into torques.
        estimator: estimates the state for controller and filter; None gives them the truth.
        footprint: measures the whole robot's distance to the regions; None for a point.
        feedback: the state on which the loop is closed, a name of `FEEDBACK`.
        watch: detects a plant that is not the declared one.
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
        choose("feedback", feedback, dict.fromkeys(FEEDBACK))
        self.controller, self.watch, self.feedback = controller, watch, feedback
        self._estimator = estimator
        self._u: Array = np.zeros(2)
        super().__init__(simulation, footprint, look_ahead=0.0)

    def rest(self, position: Array) -> None:
        """Be at rest at a position (2,) [m]."""
        super().rest(position)
        self._estimated: Array | None = None  # (41,) the estimated state; None for the truth

    def _begin(self, rng: np.random.Generator) -> None:
        if self._estimator is not None:
            # sensor errors have a separate stream, so that a seed draws the same plant without them
            (sensor_rng,) = rng.spawn(1)
            self._estimated = self._estimator.reset(self.simulation.truth, sensor_rng)
        self.controller.reset(self.simulation.state(self._estimated))
        self.watch.reset()

    def hold(self, u: Array, barriers: BarrierSet, time: float) -> Motion:
        """Hold the model's u (2,) [m/s²] for the control step that begins at a time [s]."""
        self._u = u
        motion = self._run(barriers, time)
        self.watch.judge(self.controller.lift)
        return motion

    def _tick(self, k: int) -> bool:
        simulation, controller = self.simulation, self.controller
        state = simulation.state(self._estimated)
        torque = controller.step(state, self._u)
        self.watch.tick(state.vector, torque, controller.stance)
        simulation.step(torque)
        if simulation.diverged:
            return False
        if self._estimator is not None:
            self._estimated = self._estimator.tick(simulation.truth)
        return True

    def estimate(self, time: float) -> Estimate:
        """Return the state on which the loop is closed, at a time since the reset [s]."""
        trunk = self.truth if self._estimated is None else self._estimated[BASE]
        reference = self.controller.reference
        model = np.concatenate([reference.position, reference.velocity])
        position = np.concatenate([trunk[:2], model[2:]])
        x = {"measured": trunk, "position": position, "rom": model}[self.feedback]
        covariance, yaw = None, self.simulation.yaw
        if self._estimator is not None:
            estimate = self._estimator.estimate
            covariance, yaw = estimate.covariance, estimate.yaw
        fault = REASON_OF_FAULT[self.watch.fault]
        return Estimate(x, time, covariance, model, trunk - model, np.float64(yaw), fault=fault)

    def diagnostics(self) -> Info:
        """Return the controller's record for the infos, as arrays and numbers of float64."""
        return {
            name: np.asarray(value, dtype=np.float64) if np.ndim(value) else np.float64(value)
            for name, value in self.controller.diagnostics._asdict().items()
        }
