"""Whether an episode tests rank 1: what u* would have done, and what the filter did."""

from collections.abc import Callable

import numpy as np

from hcbf_gym.arrays import Array, Info
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.reduced_order import ReducedOrderModel

AHEAD = (0.25, 0.5, 0.75, 1.0)
"""When a held u* may have entered [s]."""
CHANGED = 1e-3
"""‖u − u*‖ from which the filter has changed an input, as a share of the greatest of U."""
JUMP = 10.0
"""How many times the usual step a step is that no robot makes."""
WHOLE = 0.2
"""And what share of all that h went through in the episode."""

Strict = Callable[[Array, Array], Array]
"""(x (j, n), t (j,)) → (j, m) the strict h's on the position."""


def pressed(
    model: ReducedOrderModel,
    input_set: InputSet,
    x: Array,
    time: float,
    strict: Strict,
    report: Info,
) -> bool:
    """Return whether the filter changed an input that would have entered rank 1 within a second.

    Args:
        model: of the plant.
        input_set: U, to which u* is cut.
        x: (n,) the state before the step.
        time: [s].
        strict: h's.
        report: of the filter for this step.
    """
    if not report["intervention"] > CHANGED * input_set.radius:
        return False
    wanted = input_set.project(np.asarray(report["u_nominal"], dtype=np.float64))
    path = np.array([model.step(x, wanted, s) for s in AHEAD])
    return bool((strict(path, time + np.array(AHEAD)) < 0.0).any())


def check_jumps(source: str, went: list[Array], expected: list[Array]) -> None:
    """Refuse an episode whose environment resets itself, so that the state jumps.

    Args:
        source: of the environment.
        went: of each sample (m,) strict h's on the position.
        expected: of each step (m,) where the model would have been.

    Raises:
        InvalidInputError: if there is a step that no robot makes.
    """
    if len(expected) < 3:
        return
    h = np.array(went)
    off = np.abs(h[1:] - np.array(expected)).max(axis=1)
    usual = max(np.median(off), np.median(np.abs(np.diff(h, axis=0)).max(axis=1)))
    k = int(off.argmax())
    if off[k] > max(JUMP * usual, WHOLE * np.ptp(h, axis=0).max()):
        raise InvalidInputError(
            f"{source}: got a state that jumps in step {k + 1}, by {off[k]:.3g} in h where "
            f"{usual:.3g} is usual, expected an episode that ends (terminated or truncated) rather "
            "than an environment that resets itself"
        )
