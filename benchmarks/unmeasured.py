"""Which faults of unmeasured robots on wheels are reported, and how soon.

A robot drives from goal to goal in a room with boxes. Its τ, δ and noise are any that the rows
assume, and one message of ten is lost. From some time on it has a fault. Time counts while the
robot is commanded at least half of its greatest speed; cases without so much driving are drawn
anew.
"""

import itertools
import math
from collections import deque
from typing import NamedTuple

import numpy as np

from benchmarks.own_loop import Body, Driven, Link, Moving, Rig, boxes_of, loop
from hcbf_gym.arrays import Array
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_robots import Command, Robot, VelocityFilter

FLEET = {  # Command, reach [m] and period [s]
    "TurtleBot 3": (Command(0.22, 2.84, look_ahead=0.08), 0.11, 0.06),
    "TurtleBot 4": (Command(0.46, 1.9, look_ahead=0.12), 0.19, 0.1),
    "Nav2's stock robot": (Command(0.5, 1.0, look_ahead=0.15), 0.22, 0.04),
    "AMR": (Command(1.5, 1.5, look_ahead=0.4), 0.5, 0.06),
    "small mecanum": (Command(0.6, 1.0, sideways=0.6), 0.2, 0.06),
    "mecanum": (Command(0.8, 1.5, sideways=0.6), 0.25, 0.1),
    "omni": (Command(1.0, 2.0, sideways=1.0), 0.3, 0.04),
    "fast omni": (Command(1.5, 2.0, sideways=1.5), 0.35, 0.06),
}
LATE, TURNED = "commands 1 s late", "yaw 90° off"
FAULTS = {  # The share of the motion that odometry counts
    "odometry half": 0.5,
    "odometry double": 2.0,
    "odometry dead": 0.0,
    "odometry reversed": -1.0,
    TURNED: 1.0,
    LATE: 1.0,
}
WITHIN = 2.0  # Time in which a fault is reported [s]
PAUSE = 0.2  # For which a robot may be slower meanwhile [s]
NOISE = np.array([0.02, 0.02, math.radians(1.0)])
"""Standard deviations of a pose [m, rad], and of a twist, halved [m/s, rad/s]."""


class Unmeasured(Moving):
    """A robot with any τ and δ that the rows assume, noise, and a fault from some time on."""

    def __init__(self, name: str, fault: str | None, seed: int):
        self._rng, self._fault = np.random.default_rng([8, seed]), fault
        self._command, reach, self._period = FLEET[name]
        known, rng = Robot(self._command, reach=reach), self._rng
        start = np.array([0.0, 0.0, rng.uniform(-math.pi, math.pi)])
        super().__init__(Body(known, rng.uniform(0.0, 0.3), rng.uniform(0.0, 0.1)), start)
        self._size = 1.0 + self._command.forward
        self._filter = VelocityFilter(
            known, boxes_of(rng, self._size), period=self._period, max_age=0.5, on_alarm="brake"
        )
        self._begins = 0.0 if fault == LATE else rng.uniform(4.0, 8.0)
        self._begun: Array | None = None  # where the fault begins
        still = np.zeros(len(self._command.limits))
        self._command_now, self._waiting_1s = still, deque([still] * round(1.0 / CONTROL_DT))
        self._goal, self._left, self._speed = np.zeros(2), 0.0, 0.0
        self._driven = self._slow = self._reported_for = self.fast = 0.0

    def _plan(self, pose: Array) -> Array:
        """Return a command to the goal; each counts for some seconds."""
        self._left -= self._period
        if self._left < 0.0:
            self._goal = self._rng.uniform(-3.5, 3.5, 2) * self._size
            self._left = self._rng.uniform(3.0, 8.0)
            self._speed = self._rng.uniform(0.7, 1.0) * self._command.forward
        d = self._goal - pose[:2]
        error = math.remainder(math.atan2(d[1], d[0]) - pose[2], math.tau)
        most = 0.6 * self._command.turn
        turn = min(max(2.0 * error, -most), most)
        if self._command.sideways is None:
            return np.array([self._speed * max(0.0, math.cos(error)) ** 3, turn])
        return np.array([self._speed * math.cos(error), self._speed * math.sin(error), turn])

    def odometry(self) -> tuple[Array, Array]:
        """Return pose and twist of the odometry."""
        pose, twist = self.pose, self.twist
        if self._begun is not None and self._fault is not None:
            share = np.array([FAULTS[self._fault], FAULTS[self._fault], 1.0])
            pose, twist = self._begun + share * (pose - self._begun), share * twist
            pose = pose + np.array([0.0, 0.0, 0.5 * math.pi * (self._fault == TURNED)])
        noise = self._rng.normal(size=6)
        return pose + NOISE * noise[:3], twist + 0.5 * NOISE * noise[3:]

    def go(self, command: Array) -> None:
        """Follow a command for one control step."""
        fast = float(np.linalg.norm(command[:-1])) >= 0.5 * self._command.forward
        if self._begun is None and fast and self._driven >= self._begins:
            self._begun = self.pose
        if self._reported_for > 0.0:
            self._reported_for += CONTROL_DT
        elif self._begun is not None:
            self._slow = 0.0 if fast else self._slow + CONTROL_DT
            self.fast = self.fast + CONTROL_DT if self._slow < PAUSE else 0.0
        if self._rng.random() >= 0.1:
            self._command_now = command
        self._waiting_1s.append(self._command_now)
        late = self._waiting_1s.popleft()
        super().go(late if self._fault == LATE else self._command_now)
        self._driven += CONTROL_DT

    def drive(self, seconds: float) -> Driven:
        """Run the loop; with a fault it ends soon after the report, or when that is too late."""

        def ends(_: Array) -> bool:
            if self._filter._odometry.fault and self._reported_for == 0.0:
                self._reported_for = CONTROL_DT
            late = self.fast > WITHIN + 1.0
            return self._fault is not None and (late or self._reported_for > 1.0)

        rig = Rig(0.0, Link(50.0, 0.02, 0.5, 0.1), period=self._period)
        return loop(self._filter, self, self._plan, seconds, 0, rig, ends)


class Seen(NamedTuple):
    """After how long a fault is reported [s], as what, and whether the robot then stops."""

    after: float
    reasons: set[int]
    stops: bool


def cases(name: str, fault: str, count: int) -> list[Seen]:
    """Return what is seen in so many cases of a fault."""
    found: list[Seen] = []
    for seed in itertools.count():
        robot = Unmeasured(name, fault, seed)
        run = robot.drive(60.0)
        if run.alarms or robot.fast > WITHIN:
            after = robot.fast if run.alarms else math.inf
            found.append(Seen(after, run.alarms, bool(run.alarms) and not run.commands[-10:].any()))
        if len(found) == count or seed >= 4 * count:
            return found
    return found


def honest(count: int, seconds: float) -> list[tuple[str, int, set[int]]]:
    """Return the alarms of robots without a fault: name, seed and reasons."""
    names = list(FLEET)
    runs = ((names[k % len(names)], k) for k in range(count))
    seen = ((name, k, Unmeasured(name, None, 10_000 + k).drive(seconds)) for name, k in runs)
    return [(name, k, run.alarms) for name, k, run in seen if run.alarms]
