"""Does the environment apply what the filter chose? The input it seems to have received tells.

At every sample the state's change over one period is compared with what the model makes of the
chosen input. The difference, as an input Δu, says two things.

``model_error`` is its root mean square with the time constant `WINDOW`,
``E ← E + (T/τ)(‖Δu‖² − E)``.

The alarm counts samples, so that it makes no difference how large they are. A sample tells
something where the filter asked for something, ``‖u‖ > FLOOR ū`` with ū the largest input; then it
is missed where ``‖Δu‖ > SHARE ‖u‖``. The alarm is raised where most of the last `TELLING` samples
that tell were missed. A gain of 2 misses every one that is not cut off at the limits.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.models.plant import Reason
from hcbf_gym.models.reduced_order import ReducedOrderModel

Array = NDArray[np.float64]

WINDOW = 0.5
"""τ, over which squared errors are averaged [s]."""
FLOOR = 0.05
"""Share of the largest input below which a chosen input tells nothing: rounding, noise at rest."""
SHARE = 0.5
"""Share of the chosen input from which on it was missed: a gain of 2 is off by all of it."""
TELLING = 25
"""Samples over which the share of misses is averaged."""
LEAST_SAMPLES = 10
"""Telling samples since the reset before which no alarm is raised."""
MOST = 0.5
"""Share of misses above which the alarm is raised."""

ERROR, MISSED, SAMPLES = range(3)
"""Columns of what is remembered: E, the share of misses, and the samples that tell."""


@njit(cache=True)
def account(
    memory: Array, error: float, chosen: float, rate: float, radius: float
) -> tuple[float, bool]:
    """Count one sample's ‖Δu‖² and ‖u‖² in (3,), and return √E and whether most were missed.

    Args:
        memory: (3,) zeros at a reset.
        error: ‖Δu‖².
        chosen: ‖u‖².
        rate: T/τ.
        radius: the largest norm of an input.
    """
    memory[ERROR] += min(1.0, rate) * (error - memory[ERROR])
    if chosen > (FLOOR * radius) ** 2:
        missed = 1.0 if error > SHARE * SHARE * chosen else 0.0
        memory[SAMPLES] += 1.0
        memory[MISSED] += (missed - memory[MISSED]) / min(memory[SAMPLES], TELLING)
    alarm = memory[SAMPLES] >= LEAST_SAMPLES and memory[MISSED] > MOST
    return np.sqrt(memory[ERROR]), alarm


class Monitor:
    """The same for one plant of any model.

    Args:
        model: ẋ = f(x) + g(x)u.
        period: T [s]; None means that nothing can be expected of the next state.
        radius: the largest norm of an input.
    """

    def __init__(self, model: ReducedOrderModel, period: float | None, radius: float):
        self._model, self._period, self._radius = model, period, radius
        self.memory = np.zeros(3)
        self.alarm = Reason.NONE
        self._expected: tuple[Array, Array, Array] | None = None
        self._g = self._to_input = np.empty((0, 0))

    def forget(self) -> None:
        """Start a new episode."""
        self.memory[:] = 0.0
        self.alarm = Reason.NONE
        self._expected = None

    def expect(self, x: Array, u: Array) -> None:
        """Note what the model makes of the state x (n,) under the chosen input u (n_u,)."""
        if self._period is not None:
            after = self._model.step(x, u, self._period)
            self._expected = after, self._model.g(x), u

    def observe(self, x: Array) -> float:
        """Account for the state x (n,) that came, and return the model error [unit of u]."""
        if self._expected is None or self._period is None:
            return float(np.sqrt(self.memory[ERROR]))
        expected, g, u = self._expected
        if not np.array_equal(g, self._g):  # of most models it is constant
            self._g, self._to_input = g.copy(), np.linalg.pinv(g)
        miss = self._to_input @ (x - expected) / self._period
        rate = self._period / WINDOW
        error, missed = account(self.memory, float(miss @ miss), float(u @ u), rate, self._radius)
        if missed and self.alarm == Reason.NONE:
            self.alarm = Reason.INPUT
        return error
