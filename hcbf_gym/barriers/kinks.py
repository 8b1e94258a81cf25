"""Derivatives of a barrier h at a kink, where h is finite and a derivative is not.

An example is h = 1 − ‖v‖ at rest. The derivatives are then taken at ``x + STEP d``, a small step
beside the state x. The direction d is that of the velocity, or at rest that of u*, because the
plant moves into the part of h on that side. If the derivatives are not finite there either, d is
the first axis of an input along which they are.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier, Jet, checked, is_plain
from hcbf_gym.errors import InvalidInputError, SafetyWarning, shown, warn_caller
from hcbf_gym.models.reduced_order import DoubleIntegrator, ReducedOrderModel

STEP = 1e-6
"""The length of the step beside a kink, in units of the state."""
SMOOTH = (
    "expected a smooth formula, such as jnp.sqrt(s + 1e-6) in the place of jnp.sqrt(s), and a "
    "minimum of functions as a condition of the same rank for each"
)


@dataclass(frozen=True)
class Kinks:
    """Evaluates barriers of N plants beside a kink at one step, and warns once of each barrier."""

    u: Array | None = None  # (n_u,) or (N, n_u) u* of the plants; None where it is not known
    warned_names: set[str] = field(default_factory=set)  # of barriers, shared by all steps

    def of_plant(self, i: int) -> "Kinks":
        """Return an object for plant i alone, which has the index 0 in its calls."""
        u = None if self.u is None else np.atleast_2d(self.u)[i]
        return Kinks(u, self.warned_names)

    def states_beside(self, model: ReducedOrderModel, x: Array, i: int) -> Iterator[Array]:
        """Yield states (n,) one step beside the state x (n,) of plant i, the best one first."""
        u = np.zeros(model.n_u) if self.u is None else np.atleast_2d(self.u)[i]
        f, g = model.terms(x)
        if isinstance(model, DoubleIntegrator):
            v = x[model.n_u :]
            motion = np.tile(v if v.any() else u, 2)  # position and velocity change alike
        else:
            motion = f if f.any() else g @ u
        along_inputs = [np.eye(model.n)[j] + g[:, j] for j in range(model.n_u)]
        for direction in (motion, *along_inputs):
            length = float(np.linalg.norm(direction))
            if 0.0 < length < np.inf:
                yield x + STEP / length * direction

    def jet(self, model: ReducedOrderModel, barrier: Barrier, x: Array, t: float, i: int) -> Jet:
        """Return a barrier's jet at the state x (n,) of plant i and the time t [s].

        At a kink it has h at x and the derivatives beside x.

        Raises:
            InvalidInputError: if the barrier returns no jet, h is not finite, or the derivatives
                are finite neither at x nor beside it.
        """
        jet = barrier.jet(x, t)
        if isinstance(jet, Jet) and is_plain(jet, model.n):
            return jet
        jet = checked(barrier, jet, model.n, finite=False)
        if _is_finite(jet):
            return jet
        if not np.isfinite(jet.h):
            raise InvalidInputError(
                f"{barrier.name}: got the jet {shown(jet)}, expected finite numbers"
            )
        for beside in self.states_beside(model, x, i):
            jet_beside = checked(barrier, barrier.jet(beside, t), model.n, finite=False)
            if _is_finite(jet_beside):
                self.warn_once(barrier, x)
                return jet_beside._replace(h=jet.h)
        raise InvalidInputError(
            f"{barrier.name}: the gradient of h is not finite at x = {x.tolist()}; {SMOOTH}"
        )

    def warn_once(self, barrier: Barrier, x: Array) -> None:
        """Warn that the derivatives of a barrier at the state x (n,) are those beside it."""
        if barrier.name not in self.warned_names:
            self.warned_names.add(barrier.name)
            warn_caller(
                f"{barrier.name}: h is finite and its gradient is not at x = {x.tolist()}: it is "
                f"taken {STEP:g} beside, along the motion; {SMOOTH}",
                SafetyWarning,
            )


def _is_finite(jet: Jet) -> bool:
    return all(np.isfinite(derivative).all() for derivative in jet)
