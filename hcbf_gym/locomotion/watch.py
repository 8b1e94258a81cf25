"""Detection of a plant that differs from the declared one, by a walking robot.

Three signals over the last half second show the difference. They follow from data that the
controller has: its plan of stance and swing, the measured or estimated state, the contacts, and the
torques that it commanded.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask, packed
from hcbf_gym.locomotion.leg import LegGeometry
from hcbf_gym.locomotion.records import LEGS
from hcbf_gym.locomotion.state import STATE_SIZE

JUDGEMENT_INTERVAL = 0.04
"""The time between two judgements [s]. Compiled code sums up several ticks in one call, because a
call takes longer than the sums of a tick."""
WINDOW: int = _core.WATCH_WINDOW
"""The number of judgements over which the signals are taken."""
LEAST_FILLED = 0.25
"""The share of the window that must be filled before signals are taken."""
SETTLING = 0.01
"""The time of contact after which a foot's leg measures the trunk's velocity [s]."""
SLIP_INTERVAL = 0.01
"""The time between two samples of the stance feet [s]; more samples take time and add little."""
EXCESS_DELAY = 0.02
"""The lag is searched among delays that exceed the declared one by up to this time [s]."""


class Fault(IntEnum):
    """A difference between the plant and the declared one, by the signal that shows it."""

    NONE = 0
    SLIP = 1
    LAG = 2
    LIFT = 3


class WatchBounds(NamedTuple):
    """The largest signals that declared plants cause; a larger signal is a fault.

    Attributes:
        slip: the largest slip [m/s].
        lag: the largest lag, a difference of correlations [-].
        lift: the largest lift [m/s²].
        delay: the longest declared delay between a measurement and its torque [s].
    """

    slip: float
    lag: float
    lift: float
    delay: float


class Watch:
    """Compares the controller's plan with the motion of the robot.

    *Slip* is the speed of feet in planned stance over the ground, ``mean |v − v_foot|``, where
    ``v_foot`` is the trunk's velocity that a foot measures if it does not slip. A mean is taken, as
    a push makes feet slip fast but shortly, which a root mean square would show less. *Lag* is how
    much better late torques explain the swinging joints, ``max_{d > D} c_d − max_{d ≤ D} c_d``
    with ``c_d = corr(Δ²q̇_k, Δτ_{k−1−d})`` and D the longest declared delay in ticks. *Lift* is the
    mean acceleration that the controller has learnt to hold the trunk's height. All are taken over
    the last half second, and are 0 until `LEAST_FILLED` of it has passed.

    Args:
        legs: lengths of the legs.
        foot_radius: radius of the feet [m].
        timestep: time between two ticks [s].
        bounds: a larger signal is a fault.
    """

    def __init__(
        self, legs: LegGeometry, foot_radius: float, timestep: float, bounds: WatchBounds
    ) -> None:
        self.bounds = bounds
        # these times count ticks
        settled = max(round(SETTLING / timestep), 1)
        every = max(round(SLIP_INTERVAL / timestep), 1)
        self._declared_delay = round(bounds.delay / timestep)
        delays = self._declared_delay + 1 + max(round(EXCESS_DELAY / timestep), 1)
        self._stances = np.zeros((round(JUDGEMENT_INTERVAL / timestep), 4), dtype=np.bool_)
        self._compiled = _core.FaultDetection(
            packed(legs, LEGS), foot_radius, settled, every, delays
        )
        self.reset()

    def reset(self) -> None:
        """Forget all ticks."""
        self._compiled.reset()
        self._states: list[Array] = []
        self._torques: list[Array] = []
        self._judgements = 0
        self.slip = self.lag = self.lift = 0.0  # [m/s], [-], [m/s²]
        self.fault = Fault.NONE

    def tick(self, state: Array, torque: Array, stance: Mask) -> None:
        """Record a tick of the controller; state and torque are referenced, not copied.

        Args:
            state: (41,) the vector of the `RobotState` that the controller read.
            torque: (12,) the torques that it commanded [N·m].
            stance: (4,) the feet in planned stance.
        """
        self._stances[len(self._states)] = stance
        self._states.append(state)
        self._torques.append(torque)

    def judge(self, lift: float) -> None:
        """Update signals and fault, if `JUDGEMENT_INTERVAL` has passed since the last update.

        Args:
            lift: the acceleration that the controller has learnt to hold the trunk's height [m/s²].
        """
        if len(self._states) < len(self._stances):
            return
        states = np.concatenate(self._states).reshape(-1, STATE_SIZE)
        torques = np.concatenate(self._torques).reshape(-1, 12)
        self._states, self._torques = [], []
        row = self._judgements % WINDOW
        self._compiled.add_up(row, states, torques, self._stances, lift)
        self._judgements += 1
        if self._judgements < LEAST_FILLED * WINDOW:
            return
        signals = self._compiled.signals(self._judgements, self._declared_delay)
        self.slip, self.lag, self.lift = signals
        self.fault = self._fault()

    def _fault(self) -> Fault:
        """Return the first fault whose signal is above its bound."""
        if self.slip > self.bounds.slip:
            return Fault.SLIP
        if self.lag > self.bounds.lag:
            return Fault.LAG
        return Fault.LIFT if self.lift > self.bounds.lift else Fault.NONE
