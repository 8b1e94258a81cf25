"""Does the environment apply what the filter chose? The input it seems to have received tells.

At every sample the state's change over one period is compared with what the model makes of the
chosen input. The difference, as an input Δu, is squared and averaged with the time constant
`WINDOW`, and so is the chosen input: ``E_Δ ← E_Δ + (T/τ)(‖Δu‖² − E_Δ)``. ``model_error = √E_Δ``.
"""

import warnings
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.models.reduced_order import ReducedOrderModel

Array = NDArray[np.float64]

WINDOW = 0.5
"""τ, over which errors are averaged [s]: a few of the samples that a delay or a hold spoils."""
FLOOR = 0.1
"""Share of the largest input below which an error raises no alarm: rounding and small inputs."""
SHARE = 0.5
"""Share of the chosen input's mean square above which an error raises the alarm. A gain of 2 has
1, a delay of unrelated inputs 2."""
LEAST_SAMPLES = 5
"""Samples since the reset before which no alarm is raised."""

ERROR, INPUT, SAMPLES, ALARM = range(4)
"""Columns of a monitor's memory: E_Δ, the input's mean square, samples, whether it has alarmed."""


@njit(cache=True)
def account(memory: Array, error: float, chosen: float, rate: float, radius: float) -> float:
    """Average one sample's ‖Δu‖² and ‖u‖² into a plant's memory (4,), and return √E_Δ."""
    memory[SAMPLES] += 1.0
    memory[ERROR] += rate * (error - memory[ERROR])
    memory[INPUT] += rate * (chosen - memory[INPUT])
    bound = max((FLOOR * radius) ** 2, SHARE * memory[INPUT])
    if memory[SAMPLES] >= LEAST_SAMPLES and memory[ERROR] > bound:
        memory[ALARM] = max(memory[ALARM], 1.0)
    return np.sqrt(memory[ERROR])


@njit(cache=True)
def account_planar(memory: Array, last: Array, x: Array, period: float, radius: float) -> float:
    """Account for one sample of a planar double integrator, ``Δu = (v' − v)/T − u``.

    Args:
        memory: (4,) of the plant.
        last: (5,) v (2,) of the model and u (2,) of the sample before, and whether there was one.
        x: (4,) state of the model.
        period: T [s].
        radius: the largest norm of an input.
    """
    if last[4] == 0.0:
        return np.sqrt(memory[ERROR])
    error = chosen = 0.0
    for i in range(2):
        u = last[2 + i]
        miss = (x[2 + i] - last[i]) / period - u
        error += miss * miss
        chosen += u * u
    return account(memory, error, chosen, min(1.0, period / WINDOW), radius)


class Monitor:
    """The same for one plant of any model.

    Args:
        model: ẋ = f(x) + g(x)u.
        period: T [s]; None means that nothing can be expected of the next state.
        radius: the largest norm of an input.
    """

    def __init__(self, model: ReducedOrderModel, period: float | None, radius: float):
        self._model, self._period, self._radius = model, period, radius
        self.memory = np.zeros((1, 4))
        self._expected: tuple[Array, Array, Array] | None = None

    def forget(self) -> None:
        """Start a new episode; an alarm that was raised stays raised."""
        self.memory[:, :ALARM] = 0.0
        self._expected = None

    def expect(self, x: Array, u: Array) -> None:
        """Note what the model makes of the state x (n,) under the chosen input u (n_u,)."""
        if self._period is not None:
            after = self._model.step(x, u, self._period)
            self._expected = after, self._model.g(x), u

    def observe(self, x: Array) -> float:
        """Account for the state x (n,) that came, and return the model error [unit of u]."""
        if self._expected is None or self._period is None:
            return float(np.sqrt(self.memory[0, ERROR]))
        expected, g, u = self._expected
        miss = np.linalg.lstsq(g, (x - expected) / self._period, rcond=None)[0]
        rate = min(1.0, self._period / WINDOW)
        return account(self.memory[0], float(miss @ miss), float(u @ u), rate, self._radius)


def warn_once(memory: Array) -> None:
    """Warn of every alarm in the memory (N, 4) that was not warned of yet, in one warning."""
    if (memory[:, ALARM] != 1.0).all():
        return
    errors = np.sqrt(memory[memory[:, ALARM] == 1.0, ERROR])
    memory[:, ALARM] = 2.0
    warnings.warn(
        "the environment does not apply what the filter chose: the input that its states show is "
        f"{errors.max():.3g} (root mean square over {WINDOW} s) from the filter's; expected no "
        "wrapper, delay, hold or gain between filter and robot, and a model like the plant",
        stacklevel=4,
    )


def memory(count: int) -> Any:
    """Return the memory (N, 4) of N plants that nothing is known of."""
    return np.zeros((count, 4))
