"""Whether a user's own h is convex in the position, as rows between samples and margins assume."""

from collections.abc import Sequence

import numpy as np

from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.errors import SafetyWarning, warn_caller
from hcbf_gym.models.control_affine import ControlAffine
from hcbf_gym.models.reduced_order import ReducedOrderModel

_PAIRS = 64
_SPREAD = 3.0  # standard deviation of the sampled positions, in units of the state
_ROUNDING = 1e-6  # relative to 1 + |h|


def is_convex(barrier: Barrier, model: ReducedOrderModel) -> bool:
    """Return whether ``h((a + b)/2) ≤ (h(a) + h(b))/2`` at sampled states that differ in position.

    It is True where that is unknown: where the barrier gives no finite numbers, and for a
    `ControlAffine` model, of whose state no part is known to be the position.

    Args:
        barrier: a condition of any class.
        model: the model whose states the barrier reads, the position first.
    """
    if isinstance(model, ControlAffine):
        return True
    rng = np.random.default_rng(0)
    position = slice(model.velocity_at or min(2, model.n))
    for _ in range(_PAIRS):
        a = rng.normal(size=model.n)
        b = a.copy()
        b[position] = rng.normal(0.0, _SPREAD, b[position].shape)
        try:
            chord = 0.5 * (barrier.h(a) + barrier.h(b))
            if barrier.h(0.5 * (a + b)) > chord + _ROUNDING * (1.0 + abs(chord)):
                return False
        except Exception:  # a user's own barrier may raise anything
            return True
    return True


def warn_of_concave(barriers: Sequence[Barrier], model: ReducedOrderModel) -> None:
    """Warn of conditions of rank 1 on the position that are not convex in it."""
    strict = [barrier for barrier in barriers if barrier.priority == 1 and barrier.reads_position]
    names = [barrier.name for barrier in strict if not is_convex(barrier, model)]
    if names:
        warn_caller(
            f"safety filter: h of {names} is not convex in the position at sampled states, so that "
            "it may fall below its margin between two samples; expected the outside of a convex "
            "region, one condition for each, or a larger margin and a shorter period",
            SafetyWarning,
        )
