"""Hooks, by which a family of random scenes defines its own observation, reward and costs."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, as_array


class Moment(NamedTuple):
    """The data of N robots at the end of a control step, or at a reset, for reward and costs.

    Attributes:
        before: (N, 4) position [m] and velocity [m/s] when the step began.
        x: (N, 4) the same at its end; at a reset, both are the start.
        reference: (N, 6) position, velocity and acceleration of the reference.
        sensed: (N, m, 4) of the scene's conditions: h, its unit gradient, ∂h/∂t.
        min_h: (N, k) least h in the step, the environment's own speed limit included.
        u: (N, 2) the applied acceleration [m/s²]; zero at a reset.
    """

    before: Array
    x: Array
    reference: Array
    sensed: Array
    min_h: Array
    u: Array


class Hooks(NamedTuple):
    """Observation, reward and costs of a family's environments; None is the usual one.

    Each row of a result may depend on the same row of the arguments alone, so that one robot gets
    the values that it gets among N.

    Attributes:
        observe: (x (N, 4), reference (N, 6), sensed (N, m, 4)) → (N, n) the observation.
        reward: Moment → (N,) the reward, which infos have as `reward_own`.
        costs: Moment → (N, k) the infos' `costs`; `cost` stays 1 where rank 1 was entered.
    """

    observe: Callable[[Array, Array, Array], Array] | None = None
    reward: Callable[[Moment], Array] | None = None
    costs: Callable[[Moment], Array] | None = None

    @property
    def sees_steps(self) -> bool:
        """Whether a hook takes a `Moment`."""
        return self.reward is not None or self.costs is not None


NO_HOOKS = Hooks()


def checked_result(hook: str, result: object, n: int, axes: int) -> Array:
    """Return a float64 copy of the array that a hook of some name returned for N robots.

    Raises:
        InvalidInputError: if it has not so many axes, the first of length N, or an entry is not a
            finite number.
    """
    array = as_array(f"hook {hook}", result)
    if array.dtype.kind not in "fiub" or array.ndim != axes or len(array) != n:
        expected = f"({n},)" if axes == 1 else f"({n}, …)"
        raise InvalidInputError(
            f"hook {hook}: got shape {array.shape} of {array.dtype}, expected {expected} of numbers"
        )
    array = array.astype(np.float64)
    if not np.isfinite(array).all():
        raise InvalidInputError(f"hook {hook}: got {array.tolist()}, expected finite numbers")
    return array
