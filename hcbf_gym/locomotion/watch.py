"""Detection of a plant that is not the declared one, by a walking robot.

Three signals over the last half second, from what the controller knows alone: its plan of stance
and swing, the state as measured or estimated, the contacts and the torques it commanded.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Mask, packed
from hcbf_gym.locomotion.leg import LegGeometry
from hcbf_gym.locomotion.records import LEGS
from hcbf_gym.locomotion.state import STATE_SIZE

JUDGED = 0.04
"""Between two judgements [s]: entering compiled code costs more than the ticks themselves."""

WINDOW: int = _core.WATCH_WINDOW
"""Judgements over which the signals are taken."""

FILLED = 0.25
"""Share of the window that must be filled before it is judged."""

SETTLING = 0.01
"""How long a foot must have touched before its leg shows the trunk's velocity [s]."""

LOOKED = 0.01
"""Between two looks at the feet that stand [s]; more of them cost time and show no more."""

SOUGHT = 0.02
"""How much later than the declared delay torques are looked for [s]."""


class Fault(IntEnum):
    """What the watch finds wrong with the plant."""

    NONE = 0
    SLIP = 1
    LAG = 2
    LIFT = 3


class WatchBounds(NamedTuple):
    """The largest signals on the plants that are declared.

    Attributes:
        slip: [m/s].
        lag: a difference of correlations.
        lift: [m/s²].
        delay: the longest that is declared between a measurement and its torque [s].
    """

    slip: float
    lag: float
    lift: float
    delay: float


class Watch:
    """Compares what the controller planned with what the robot did.

    *Slip* is how fast feet in planned stance move over the ground, ``mean |v − v_foot|`` with
    ``v_foot`` the trunk's velocity that a foot shows if it holds. A push makes feet slip fast but
    shortly, so that a root mean square would show less. *Lag* is how much better late torques
    explain the swinging joints, ``max_{d > D} c_d − max_{d ≤ D} c_d`` with
    ``c_d = corr(Δ²q̇_k, Δτ_{k−1−d})`` and D the longest declared delay in ticks. *Lift* is the mean
    acceleration that the controller has learnt to hold the trunk's height. All are taken over the
    last half second, and 0 until a part of it has passed.

    Args:
        legs: lengths of the legs.
        foot_radius: [m].
        timestep: between two ticks [s].
        bounds: above which a signal is a fault.
    """

    def __init__(
        self,
        legs: LegGeometry,
        foot_radius: float,
        timestep: float,
        bounds: WatchBounds,
    ) -> None:
        self.bounds = bounds
        settled, every = (max(round(time / timestep), 1) for time in (SETTLING, LOOKED))
        self._declared = round(bounds.delay / timestep)
        delays = self._declared + 1 + max(round(SOUGHT / timestep), 1)
        self._stances = np.zeros((round(JUDGED / timestep), 4), dtype=np.bool_)
        self._compiled = _core.FaultDetection(
            packed(legs, LEGS), foot_radius, settled, every, delays
        )
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._compiled.reset()
        self._states: list[Array] = []
        self._torques: list[Array] = []
        self._judgements = 0
        self.slip = self.lag = self.lift = 0.0
        self.fault = Fault.NONE

    def tick(self, state: Array, torque: Array, stance: Mask) -> None:
        """Note a tick of the controller; state and torque are referred to, not copied.

        Args:
            state: (41,) the vector of the `RobotState` that it was given.
            torque: (12,) that it commanded [N·m].
            stance: (4,) feet that it planned to carry.
        """
        self._stances[len(self._states)] = stance
        self._states.append(state)
        self._torques.append(torque)

    def judge(self, lift: float) -> None:
        """Bring signals and fault up to date, if it is time to.

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
        if self._judgements < FILLED * WINDOW:
            return
        found = self._compiled.signals(self._judgements, self._declared)
        self.slip, self.lag, self.lift = found
        self.fault = self._judged()

    def _judged(self) -> Fault:
        if self.slip > self.bounds.slip:
            return Fault.SLIP
        if self.lag > self.bounds.lag:
            return Fault.LAG
        return Fault.LIFT if self.lift > self.bounds.lift else Fault.NONE
