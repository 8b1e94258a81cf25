"""Does the pose move as the twist says? What is measured is compared at its own times.

A pose that is carried on to the present by a late twist moves otherwise than that twist, wherever
the robot brakes or turns. What was measured does not, however late it comes: with T the time from
one sample to the next, `filtering.monitor` has the law. Where samples are missing, so that T is
longer than `PAUSE` periods, the velocity may have been another one meanwhile, by which the
position differs by ``u_max T²/4`` at most.

Positions may be noisy. With ``e = Δp − T (v + v')/2``, white noise of the variance σ² correlates
two successive e by −σ², and neither a drift nor a scale does so. The mean of ``−e·e'/2`` over
`SAMPLES` samples, from `NOISE`² on, is therefore the σ² that the bound allows for. Positions are
averaged with what velocities lead to, over the time `AVERAGED` σ: what was commanded is compared
with that.
"""

import numpy as np

from hcbf_gym.arrays import Array, Records
from hcbf_gym.compilation import kernel
from hcbf_gym.filtering import monitor

PAUSE = 1.5
"""Periods from one sample to the next, beyond which some are missing."""
NOISE, NOISIEST = 0.02, 0.03
"""σ before any is known, and the greatest that is allowed for [m]."""
SAMPLES = 100
"""Over which it is averaged."""
ALLOWED = 5.0
"""Standard deviations that a position may be off in `monitor.IN_A_ROW` samples."""
AVERAGED = 40.0
"""Time over which positions are averaged, for each metre of σ [s/m]."""
ELSEWHERE = 0.2
"""Distance from the average beyond which a position is taken as it is [m]."""
LONGEST = 0.5
"""Time between two samples, forth or back, after which all starts anew [s]."""

NOTES = np.dtype(
    [
        *monitor.MEMORY,
        *monitor.PLANAR_MEMORY,
        ("time", "f8"),  # [s]
        ("begun", "i8"),
        ("missing", "f8"),  # [m]
        ("apart", "f8", 2),  # e [m]
        ("noise", "f8"),  # NOISE² − σ² [m²]
        ("place", "f8", 2),  # the position, averaged [m]
        ("left", "f8"),  # σ of it [m]
    ]
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

    @property
    def place(self) -> Array:
        """(2,) the position at the last sample, averaged [m]."""
        return self._notes[0]["place"]

    @property
    def noise(self) -> float:
        """The standard deviation of `place` in each direction [m]."""
        return float(self._notes[0]["left"])


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
        deviation = _average(note, body, passed)
        alarms = monitor.drifts(note, now, passed, note.missing + ALLOWED * deviation, False)
    else:
        note.drift[:], note.motion[:], note.bend, note.missing = 0.0, 0.0, 0.0, 0.0
        note.in_a_row = 0.0
        note.apart[:], note.left = 0.0, np.sqrt(NOISE**2 - note.noise)
        note.place[0], note.place[1] = body[0], body[1]
    monitor.note_body(note, now)
    note.time, note.begun = time, 1
    return alarms


@kernel(error_model="numpy")
def _average(note: np.record, body: Array, passed: float) -> float:
    """Let the average go on to a sample, and return σ of positions [m]."""
    x = body[0] - note.body[0] - 0.5 * passed * (body[2] + note.body[2])
    y = body[1] - note.body[1] - 0.5 * passed * (body[3] + note.body[3])
    seen = -0.5 * (x * note.apart[0] + y * note.apart[1])
    variance = NOISE**2 - note.noise
    variance += (seen - variance) / SAMPLES
    variance = min(max(variance, 0.0), NOISIEST**2)
    note.noise, note.apart[0], note.apart[1] = NOISE**2 - variance, x, y
    deviation, left = np.sqrt(variance), note.left**2
    share = passed / (passed + AVERAGED * deviation)
    share = max(share, left / max(left + variance, 1e-12))  # the mean of the first few
    note.place[0] += body[0] - note.body[0] - x
    note.place[1] += body[1] - note.body[1] - y
    x, y = body[0] - note.place[0], body[1] - note.place[1]
    if x * x + y * y > ELSEWHERE**2:
        share = 1.0
    note.place[0] += share * x
    note.place[1] += share * y
    note.left = np.sqrt((1.0 - share) ** 2 * left + share**2 * variance)
    return deviation
