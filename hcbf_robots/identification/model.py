r"""A first-order response with a delay, fitted to what a robot did.

.. math:: τ \dot v = g\, c(t - δ) - v

For every τ and δ of a grid the response to the commands is simulated with g = 1; the best g is then
a ratio of sums. The pair that leaves the least squares is taken: what the robot's own sway adds to
v does not bend it, as nothing measured is fed back.
"""

from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from hcbf_gym.arrays import Array

TIME_CONSTANTS = np.geomspace(0.01, 1.0, 60)
"""Those that are tried [s]."""
LONGEST_DELAY = 0.3
"""That is tried [s]."""


class Fit(NamedTuple):
    """One axis.

    Attributes:
        gain: g.
        time_constant: τ [s].
        delay: δ [s].
        predicted: (n,) what the model makes of the commands.
    """

    gain: float
    time_constant: float
    delay: float
    predicted: Array


def fit(command: Array, measured: Array, period: float) -> Fit:
    """Return the response that explains an axis best.

    Args:
        command: (n,) what was commanded from each sample on.
        measured: (n,) what the robot did at it.
        period: between two samples [s].
    """
    best, least = None, np.inf
    for steps in range(round(LONGEST_DELAY / period) + 1):
        commanded = late(command, steps * period, period)
        for tau in TIME_CONSTANTS:
            unit = respond(commanded, float(tau), period)
            power = float(unit @ unit)
            gain = float(unit @ measured) / power if power > 0.0 else 0.0
            left = measured - gain * unit
            error = float(left @ left)
            if error < least:
                best, least = Fit(gain, float(tau), steps * period, gain * unit), error
    assert best is not None
    return best


def late(command: Array, delay: float, period: float) -> Array:
    """Return (n,) the commands as they come after a delay [s], zero before."""
    return np.concatenate([np.zeros(round(delay / period)), command])[: len(command)]


def respond(command: Array, time_constant: float, period: float) -> Array:
    """Return (n,) the first-order response to a held command, from rest."""
    keep = float(np.exp(-period / time_constant))
    # what is commanded from sample k on shows at sample k + 1
    return np.asarray(lfilter([0.0, 1.0 - keep], [1.0, -keep], command), dtype=np.float64)
