"""Gaits as data, and the clock that says which foot stands."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hcbf_gym.locomotion.state import Array

EARLY_TOUCHDOWN = 0.6  # share of the swing after which a touching foot becomes stance


class Gait(NamedTuple):
    """When each foot swings.

    Attributes:
        period: of a stride [s].
        duty: share of the period that a foot stands.
        offsets: phase of FR, FL, RR, RL at time zero; a foot stands while its phase is below duty.
        rests: whether all feet stay down while nothing is asked and nothing disturbs.
    """

    period: float
    duty: float
    offsets: tuple[float, float, float, float]
    rests: bool

    @property
    def stance_time(self) -> float:
        """How long a foot stands [s]."""
        return self.duty * self.period

    @property
    def swing_time(self) -> float:
        """How long a foot is in the air [s]."""
        return (1.0 - self.duty) * self.period


GAITS = {
    "trot": Gait(period=0.26, duty=0.5, offsets=(0.0, 0.5, 0.5, 0.0), rests=False),
    "stand": Gait(period=0.26, duty=0.5, offsets=(0.0, 0.5, 0.5, 0.0), rests=True),
    "walk": Gait(period=0.60, duty=0.75, offsets=(0.0, 0.5, 0.75, 0.25), rests=False),
}


class FootPhases(NamedTuple):
    """The gait's answer for one tick.

    Attributes:
        stance: (4,) bool, feet that carry.
        progress: (4,) share of the swing done, 0 for feet in stance.
        remaining: (4,) until touchdown, 0 for feet in stance [s].
    """

    stance: NDArray[np.bool_]
    progress: Array
    remaining: Array


@njit(cache=True)
def foot_phases(gait: Gait, clock: float, contact: NDArray[np.bool_]) -> FootPhases:
    """Return what each foot does at `clock` [s]; a negative clock means that all feet stand."""
    stance = np.ones(4, dtype=np.bool_)
    progress = np.zeros(4)
    remaining = np.zeros(4)
    if clock < 0.0:
        return FootPhases(stance, progress, remaining)
    for foot in range(4):
        phase = (clock / gait.period + gait.offsets[foot]) % 1.0
        if phase < gait.duty:
            continue
        share = (phase - gait.duty) / (1.0 - gait.duty)
        if contact[foot] and share > EARLY_TOUCHDOWN:
            continue
        stance[foot] = False
        progress[foot] = share
        remaining[foot] = (1.0 - phase) * gait.period
    return FootPhases(stance, progress, remaining)


class GaitClock:
    """Runs a gait in time, and lets a gait that rests stand still while all is quiet.

    Args:
        gait: the gait to run.
        timestep: of the control loop [s].
    """

    def __init__(self, gait: Gait, timestep: float) -> None:
        self.gait = gait
        self.timestep = timestep
        self.reset()

    def reset(self) -> None:
        """Start with all feet on the ground."""
        self.time = _RESTING if self.gait.rests else 0.0

    @property
    def resting(self) -> bool:
        """Whether all feet are held down."""
        return self.time < 0.0

    def advance(self, quiet: bool, contact: NDArray[np.bool_]) -> FootPhases:
        """Move on by one tick.

        Args:
            quiet: nothing is asked of the robot and nothing disturbs it.
            contact: (4,) bool, feet that touch.
        """
        phases = foot_phases(self.gait, self.time, contact)
        if self.resting:
            self.time = _RESTING if quiet else 0.0
        else:
            self.time += self.timestep
            half = 0.5 * self.gait.period
            lands = self.time // half > (self.time - self.timestep) // half
            if self.gait.rests and quiet and lands:
                self.time = _RESTING
        return phases


_RESTING = -1.0
