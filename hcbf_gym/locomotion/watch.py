"""What a walking robot notices of a plant that is not the one it was told of.

Three signals over the last half second, from what the controller knows alone: its plan of stance
and swing, the state as measured or estimated, the contacts and the torques it commanded.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbf_gym.arrays import Array, Integers, Mask, Records
from hcbf_gym.compilation import kernel
from hcbf_gym.locomotion.leg import LEGS, LegGeometry, foot_kinematics
from hcbf_gym.locomotion.leg_odometry import trunk_velocity
from hcbf_gym.locomotion.rotation import rotation_matrix
from hcbf_gym.locomotion.state import STATE_SIZE, state_views

JUDGED = 0.04
"""Between two judgements [s]: entering compiled code costs more than the ticks themselves."""

WINDOW = 12
"""Judgements over which the signals are taken."""

FILLED = 0.25
"""Share of the window that must be filled before anything is said."""

SETTLING = 0.01
"""How long a foot must have touched before its leg shows the trunk's velocity [s]."""

LOOKED = 0.01
"""Between two looks at the feet that stand [s]; more of them cost time and show no more."""

SOUGHT = 0.02
"""How much later than the declared delay torques are looked for [s]."""

LEAST = 1e-9
"""Sum of squares below which joints say nothing of a delay, for they do not move."""

# what is added up between two judgements; behind these the two sums of each delay
SLIP, STOOD, LIFT, BENT = range(4)
SUMS = 4


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


class Sampling(NamedTuple):
    """How feet that stand are looked at.

    Attributes:
        foot_radius: [m].
        settled: ticks that a foot must have touched.
        every: how many ticks there are for a look.
    """

    foot_radius: float
    settled: int
    every: int


class Memory(NamedTuple):
    """What the kernel carries from one judgement to the next.

    Attributes:
        sums: (WINDOW, SUMS + 2 delays) of each judgement in the window.
        rates: (2, 12) q̇ of the last two ticks [rad/s].
        torque: (1, 12) of the last tick [N·m].
        changes: (delays, 12) Δτ of the last ticks [N·m].
        touched: (4,) for how many ticks each foot has touched.
    """

    sums: Array
    rates: Array
    torque: Array
    changes: Array
    touched: Integers


class Watch:
    """Compares what the controller planned with what the robot did.

    *Slip* is how fast feet in planned stance move over the ground, ``mean |v − v_foot|`` with
    ``v_foot`` the trunk's velocity that a foot shows if it holds. A push makes feet slip fast but
    shortly, so that a root mean square would tell less. *Lag* is how much better late torques
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
        self._legs = np.array([tuple(legs)], dtype=LEGS)
        settled, every = (max(round(time / timestep), 1) for time in (SETTLING, LOOKED))
        self._sampling = Sampling(foot_radius, settled, every)
        self._declared = round(bounds.delay / timestep)
        delays = self._declared + 1 + max(round(SOUGHT / timestep), 1)
        self._stances = np.zeros((round(JUDGED / timestep), 4), dtype=np.uint8)
        self._memory = Memory(
            sums=np.zeros((WINDOW, SUMS + 2 * delays)),
            rates=np.zeros((2, 12)),
            torque=np.zeros((1, 12)),
            changes=np.zeros((delays, 12)),
            touched=np.zeros(4, dtype=np.int64),
        )
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        for kept in self._memory:
            kept[:] = 0
        self._states: list[Array] = []
        self._torques: list[Array] = []
        self._judgements = 0
        self.slip = self.lag = self.lift = 0.0
        self.fault = Fault.NONE

    def tick(self, state: Array, torque: Array, stance: NDArray[np.uint8]) -> None:
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
        add_up(
            self._memory,
            self._judgements % WINDOW,
            self._legs,
            self._sampling,
            states,
            torques,
            self._stances,
            lift,
        )
        self._judgements += 1
        if self._judgements < FILLED * WINDOW:
            return
        sums = self._memory.sums
        declared = self._declared
        self.slip, self.lag, self.lift = signals(sums, self._judgements, declared)
        self.fault = self._judged()

    def _judged(self) -> Fault:
        if self.slip > self.bounds.slip:
            return Fault.SLIP
        if self.lag > self.bounds.lag:
            return Fault.LAG
        return Fault.LIFT if self.lift > self.bounds.lift else Fault.NONE


@kernel()
def add_up(
    memory: Memory,
    row: int,
    legs: Records,
    sampling: Sampling,
    states: Array,
    torques: Array,
    stances: NDArray[np.uint8],
    lift: float,
) -> None:
    """Put the sums of n ticks in a row of the memory, and move that on.

    Args:
        memory: changed in place.
        row: of its sums.
        legs: (1,) `LEGS`.
        sampling: of the feet that stand.
        states: (n, 41).
        torques: (n, 12) [N·m].
        stances: (n, 4).
        lift: at the end [m/s²].
    """
    sums = memory.sums[row]
    delays = len(memory.changes)
    sums[:] = 0.0
    sums[LIFT] = lift
    rates = np.concatenate((memory.rates, states[:, 25:37]))
    commanded = np.concatenate((memory.torque, torques))
    changes = np.concatenate((memory.changes, commanded[1:] - commanded[:-1]))
    for k in range(len(states)):
        for foot in range(4):
            touches = states[k, 37 + foot] > 0.0
            memory.touched[foot] = memory.touched[foot] + 1 if touches else 0
            if stances[k, foot] == 0:
                _correlate(sums, rates[k : k + 3], changes[k : k + delays], 3 * foot)
        if (k + 1) % sampling.every == 0:
            standing = (stances[k] > 0) & (memory.touched >= sampling.settled)
            _add_slip(sums, legs[0], sampling.foot_radius, states[k], standing)
    memory.rates[:] = rates[-2:]
    memory.torque[:] = commanded[-1:]
    memory.changes[:] = changes[-delays:]


@kernel()
def _add_slip(
    sums: Array, legs: LegGeometry, foot_radius: float, vector: Array, standing: Mask
) -> None:
    """Add |v − v_foot| of the feet that stand (4,)."""
    state = state_views(vector)
    R = rotation_matrix(state.quaternion)
    feet = foot_kinematics(legs, state.joint_position, state.joint_velocity)
    for foot in range(4):
        if standing[foot]:
            shown = trunk_velocity(feet, foot_radius, foot, state, R).velocity
            sums[SLIP] += np.hypot(vector[19] - shown[0], vector[20] - shown[1])
            sums[STOOD] += 1.0


@kernel()
def _correlate(sums: Array, rates: Array, changes: Array, first: int) -> None:
    """Add a leg's share of the correlations.

    Args:
        sums: changed in place.
        rates: (3, 12) q̇ of the last ticks, the present one last [rad/s].
        changes: (delays, 12) Δτ of the ticks before the present one, the oldest first [N·m].
        first: joint of the leg.
    """
    delays = len(changes)
    for joint in range(first, first + 3):
        bend = rates[2, joint] - 2.0 * rates[1, joint] + rates[0, joint]
        sums[BENT] += bend * bend
        for delay in range(delays):
            change = changes[delays - 1 - delay, joint]
            sums[SUMS + delay] += bend * change
            sums[SUMS + delays + delay] += change * change


@kernel()
def signals(sums: Array, judgements: int, declared: int) -> tuple[float, float, float]:
    """Return slip [m/s], lag and lift [m/s²] over the window; see `Watch`.

    Args:
        sums: (WINDOW, SUMS + 2 delays).
        judgements: that have passed.
        declared: the longest delay that is declared [ticks].
    """
    total = sums.sum(axis=0)
    delays = (len(total) - SUMS) // 2
    slip = total[SLIP] / max(total[STOOD], 1.0)
    lift = total[LIFT] / min(judgements, len(sums))
    early, late = -1.0, -1.0
    for delay in range(delays):
        power = total[SUMS + delays + delay]
        if total[BENT] < LEAST or power < LEAST:
            return slip, 0.0, lift
        correlation = total[SUMS + delay] / np.sqrt(total[BENT] * power)
        if delay <= declared:
            early = max(early, correlation)
        else:
            late = max(late, correlation)
    return slip, late - early, lift
