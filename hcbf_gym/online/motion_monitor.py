"""Does the pose move as the twist says? What is measured is compared at its own times.

A pose that is carried on to the present by a late twist moves otherwise than that twist, wherever
the robot brakes or turns. What was measured does not, however late it comes: with T the time from
one sample to the next, `filtering.monitor` has the law. Where samples are missing, so that T is
longer than `PAUSE` periods, the velocity may have been another one meanwhile, by which the
position differs by ``u_max T²/4`` at most.
"""

import numpy as np

from hcbf_gym.arrays import Array, Records
from hcbf_gym.compilation import kernel
from hcbf_gym.filtering import monitor

PAUSE = 1.5
"""Periods from one sample to the next, beyond which some are missing."""
LONGEST = 0.5
"""Time between two samples, forth or back, after which all starts anew [s]."""

NOTES = np.dtype(
    [*monitor.MEMORY, *monitor.PLANAR_MEMORY, ("time", "f8"), ("begun", "i8"), ("missing", "f8")]
)


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
        return bool(_observe(self._notes, body, time, self._longest, self._hardest))


@kernel(error_model="numpy")
def _observe(notes: Records, body: Array, time: float, longest: float, hardest: float) -> bool:
    note, passed = notes[0], time - notes[0].time
    if note.begun and -LONGEST < passed <= 0.0:
        return False
    known = note.begun == 1 and 0.0 < passed <= LONGEST
    now = (body[0], body[1], body[2], body[3])
    alarms = False
    if known:
        missed = 0.25 * hardest * passed**2 if passed > longest else 0.0
        note.missing = monitor.fade(passed) * note.missing + missed
        alarms = monitor.drifts(note, now, passed, note.missing, False)
    else:
        note.drift[:], note.motion[:], note.bend, note.missing = 0.0, 0.0, 0.0, 0.0
        note.in_a_row = 0.0
    monitor.note_body(note, now)
    note.time, note.begun = time, 1
    return alarms
