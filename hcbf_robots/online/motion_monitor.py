"""Does the pose move as the twist says? What is measured is compared at its own times.

A pose that is carried on to the present by a late twist moves otherwise than that twist, wherever
the robot brakes or turns. What was measured does not, however late it comes: with T the time from
one sample to the next, `monitor.hpp` has the law. Where samples are missing, so that T is
longer than `PAUSE` periods, the velocity may have been another one meanwhile, by which the
position differs by ``u_max T²/4`` at most.

Positions may be noisy. With ``e = Δp − T (v + v')/2``, white noise of the variance σ² correlates
two successive e by −σ², and neither a drift nor a scale does so. The mean of ``−e·e'/2`` over 100
samples, from (0.02 m)² on, is therefore the σ² that the bound allows for. Positions are averaged
with what velocities lead to, over 40 s for each metre of σ: what was commanded is compared with
that. The core computes it: `motion_monitor.hpp`.
"""

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, record_type, words_of

PAUSE = 1.5
"""Periods from one sample to the next, beyond which some are missing."""
NOTES = record_type("motion_monitor.Notes")


class MotionMonitor:
    """Compares positions with velocities that were measured at the same times.

    Args:
        period: the longest regular time between two samples [s].
        hardest: the greatest acceleration of the robot [m/s²].
    """

    def __init__(self, period: float, hardest: float):
        self._longest, self._hardest = PAUSE * period, hardest
        self._notes = np.zeros(1, dtype=NOTES)

    def forget(self) -> None:
        """Start anew."""
        self._notes[:] = 0

    def observe(self, body: Array, time: float) -> bool:
        """Compare a sample with the one before, and return whether that alarms.

        Args:
            body: (4,) position [m] and velocity [m/s] in the world.
            time: of both [s]; one that does not go on says nothing.
        """
        words = words_of(self._notes)
        return _core.motion_observe(words, body, time, self._longest, self._hardest)

    @property
    def place(self) -> Array:
        """(2,) the position at the last sample, averaged [m]."""
        return self._notes[0]["place"]

    @property
    def noise(self) -> float:
        """The standard deviation of `place` in each direction [m]."""
        return float(self._notes[0]["left"])
