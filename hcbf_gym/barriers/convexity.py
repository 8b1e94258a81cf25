"""Whether a user's own h is convex in the position, as rows between samples and margins assume."""

from collections.abc import Sequence

import numpy as np

from hcbf_gym.barriers.barrier import Barrier
from hcbf_gym.errors import UNREADABLE, SafetyWarning, warn_caller
from hcbf_gym.models.control_affine import ControlAffine
from hcbf_gym.models.reduced_order import ReducedOrderModel

PAIRS = 64
ROUNDING = 1e-6


def is_convex(barrier: Barrier, model: ReducedOrderModel) -> bool:
    """Return whether ``h((a + b)/2) ≤ (h(a) + h(b))/2`` at sampled positions a and b.

    Args:
        barrier: of any class; one that gives no finite numbers is taken for convex.
        model: whose state has the position first; any h of a user's own is taken for convex.
    """
    if isinstance(model, ControlAffine):
        return True
    rng = np.random.default_rng(0)
    placed = slice(model.velocity_at or min(2, model.n))
    for _ in range(PAIRS):
        one = rng.normal(size=model.n)
        other = one.copy()
        other[placed] = rng.normal(0.0, 3.0, other[placed].shape)
        try:
            ends = 0.5 * (barrier.h(one) + barrier.h(other))
            if barrier.h(0.5 * (one + other)) > ends + ROUNDING * (1.0 + abs(ends)):
                return False
        except UNREADABLE:
            return True
    return True


def warn_of_concave(barriers: Sequence[Barrier], model: ReducedOrderModel) -> None:
    """Warn of conditions of rank 1 on the position that are not convex in it."""
    strict = [b for b in barriers if b.priority == 1 and b.reads_position]
    names = [b.name for b in strict if not is_convex(b, model)]
    if names:
        warn_caller(
            f"safety filter: h of {names} is not convex in the position at sampled states, so that "
            "it may fall below its margin between two samples; expected the outside of a convex "
            "region, one condition for each, or a larger margin and a shorter period",
            SafetyWarning,
        )
