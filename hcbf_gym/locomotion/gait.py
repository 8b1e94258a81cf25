"""Gaits as data."""

from typing import NamedTuple


class Gait(NamedTuple):
    """When each foot swings.

    Attributes:
        period: of a stride [s].
        duty: share of the period that a foot stands.
        offsets: phase of FR, FL, RR, RL at time zero; a foot stands while its phase is below duty.
        rests: whether all feet stay down without a command and a disturbance.
        max_speed: up to which it walks well [m/s].
    """

    period: float
    duty: float
    offsets: tuple[float, float, float, float]
    rests: bool
    max_speed: float


_TROT = Gait(period=0.26, duty=0.5, offsets=(0.0, 0.5, 0.5, 0.0), rests=False, max_speed=1.8)
GAITS = {
    "trot": _TROT,
    "stand": _TROT._replace(rests=True),
    "walk": Gait(period=0.6, duty=0.75, offsets=(0.5, 0.0, 0.75, 0.25), rests=False, max_speed=0.4),
}
