"""Where derivatives are taken at a kink of h: a small step beside it.

Where h(x) is finite and a derivative is not, as of ‖v‖ at rest, the derivatives are those at
``x + STEP d``: d is the direction of the velocity, at rest that of u*, and else the first axis
along which they are finite. The row is then that of the part of h into which the plant moves.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.barrier import Barrier, Jet, checked, is_plain
from hcbf_gym.errors import InvalidInputError, SafetyWarning, warn_caller
from hcbf_gym.models.reduced_order import DoubleIntegrator, ReducedOrderModel

STEP = 1e-6
"""In units of the state."""
SMOOTH = (
    "expected a smooth formula, such as jnp.sqrt(s + 1e-6) in the place of jnp.sqrt(s), and a "
    "minimum of functions as a condition of the same rank for each"
)


@dataclass
class Kinks:
    """Finds states beside a kink for each of N plants, and warns once of each barrier with one.

    Plants are counted from `first`, so that rows can be made of some of them alone.
    """

    u: Array | None = None  # (n_u,) or (N, n_u) u* of the plants; None where it is not known
    first: int = 0
    warned: set[str] = field(default_factory=set)  # names of barriers

    def from_plant(self, i: int) -> "Kinks":
        """Return the same with plant i as the first."""
        return Kinks(self.u, self.first + i, self.warned)

    def beside(self, model: ReducedOrderModel, x: Array, i: int) -> Iterator[Array]:
        """Yield states beside x (n,) of plant i, the preferred one first."""
        u = np.zeros(model.n_u) if self.u is None else np.atleast_2d(self.u)[self.first + i]
        f, g = model.terms(x)
        if isinstance(model, DoubleIntegrator):
            v = x[model.n_u :]
            moves = np.tile(v if v.any() else u, 2)
        else:
            moves = f if f.any() else g @ u
        axes = (np.arange(model.n) == j for j in range(model.n_u))
        for d in (moves, *(axis + g[:, j] for j, axis in enumerate(axes))):
            size = float(np.linalg.norm(d))
            if 0.0 < size < np.inf:
                yield x + STEP / size * d

    def jet(self, model: ReducedOrderModel, barrier: Barrier, x: Array, t: float, i: int) -> Jet:
        """Return a barrier's jet at the state x (n,) of plant i and the time t [s].

        Where derivatives are not finite at x, they are those beside x, and h is that at x.

        Raises:
            InvalidInputError: if the barrier returns no jet, h is not finite, or the derivatives
                are finite neither at x nor beside it.
        """
        jet = barrier.jet(x, t)
        if isinstance(jet, Jet) and is_plain(jet, model.n):
            return jet
        jet = checked(barrier, jet, model.n, finite=False)
        if all(np.isfinite(field).all() for field in jet):
            return jet
        if not np.isfinite(jet.h):
            raise InvalidInputError(f"{barrier.name}: got the jet {jet}, expected finite numbers")
        for beside in self.beside(model, x, i):
            other = checked(barrier, barrier.jet(beside, t), model.n, finite=False)
            if all(np.isfinite(field).all() for field in other):
                self.warn(barrier, x)
                return other._replace(h=jet.h)
        raise InvalidInputError(
            f"{barrier.name}: the gradient of h is not finite at x = {x.tolist()}; {SMOOTH}"
        )

    def warn(self, barrier: Barrier, x: Array) -> None:
        """Warn that the derivatives of a barrier are not those at x (n,), once."""
        if barrier.name in self.warned:
            return
        self.warned.add(barrier.name)
        warn_caller(
            f"{barrier.name}: h is finite and its gradient is not at x = {x.tolist()}: it is taken "
            f"{STEP:g} beside, along the motion; {SMOOTH}",
            SafetyWarning,
        )
