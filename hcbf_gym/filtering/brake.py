"""What a filter does while it knows nothing: it brings the plant to rest.

The state that was known last is carried on by the model, under the inputs that were applied since.
The input of U nearest to the one that stops the model there is applied, period after period, until
the model stands.
"""

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.filtering.belief import real_numbers
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Plant


class Brake:
    """The braking inputs of one plant.

    Args:
        plant: its `brake`, where it has one, is taken in place of the model's.
        input_set: U.
    """

    def __init__(self, plant: Plant, input_set: InputSet) -> None:
        self._plant, self._input_set = plant, input_set
        self.forget()

    def forget(self) -> None:
        """Know nothing: a new episode begins."""
        self._x: Array | None = None
        self._applied: Array | None = None

    def know(self, x: Array) -> None:
        """Take a measured state (n,) for the present one."""
        self._x = x
        self._applied = None

    def apply(self, u: Array) -> None:
        """Note the input (n_u,) that is applied from now on for one period."""
        self._applied = u

    def carry_on(self) -> None:
        """Take for the present state what the model makes of the last one: none was measured."""
        period = self._plant.period
        if self._x is None or self._applied is None or period is None:
            return
        with np.errstate(all="ignore"):
            after = self._plant.model.step(self._x, self._applied, period)
        self._x = real_numbers(after, self._x.shape)
        self._applied = None

    def input(self) -> Array:
        """Return the input of U (n_u,) that brings the plant to rest soonest."""
        n_u = self._input_set.n_u
        wanted = real_numbers(self._wanted(), (n_u,))
        return self._input_set.project(np.zeros(n_u) if wanted is None else wanted)

    def _wanted(self) -> object:
        """Return the input that stops the plant, inside U or not; None where none is known."""
        plant, x = self._plant, self._x
        if plant.brake is not None and not callable(plant.brake):
            return plant.brake
        if x is None:
            return None
        if plant.brake is not None:
            return plant.brake(x.copy())
        if plant.period is None:
            return None
        with np.errstate(all="ignore"):
            return plant.model.brake(x, plant.period)
