"""Gaits: the times at which each foot swings."""

from typing import NamedTuple


class Gait(NamedTuple):
    """The timing of a gait's swings."""

    period: float  # duration of a stride [s]
    duty: float  # share of the period for which a foot is in stance
    offsets: tuple[float, float, float, float]  # phase of FR, FL, RR, RL at time zero
    rests: bool  # whether all feet stay down without command and disturbance
    max_speed: float  # the greatest speed at which it walks well [m/s]


_TROT = Gait(period=0.26, duty=0.5, offsets=(0.0, 0.5, 0.5, 0.0), rests=False, max_speed=1.8)
GAITS = {
    "trot": _TROT,
    "stand": _TROT._replace(rests=True),
    "walk": Gait(period=0.6, duty=0.75, offsets=(0.5, 0.0, 0.75, 0.25), rests=False, max_speed=0.4),
}
