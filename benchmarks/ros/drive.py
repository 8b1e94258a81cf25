"""A node's core with simulated clocks, and a simulated cart that follows its commands."""

import math
import time
from collections.abc import Callable, Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError
from hcbf_robots.ros.core import NodeCore
from hcbf_robots.ros.decisions import Decision
from hcbf_robots.ros.parameters import read
from hcbf_robots.ros.sources import Beams
from hcbf_robots.ros.watches import Now

CART = {"max_forward": 1.0, "max_turn": 2.0, "look_ahead": 0.2, "reach": 0.3}
"""Parameters of an unmeasured cart."""
SCAN = {"observation_sources": ["scan"], "scan.type": "scan", "scan.topic": "scan"}
"""Parameters of one scan."""
HARDEST = 1.5, 4.0
"""Accelerations of the simulated robot [m/s², rad/s²]."""
TICK = 0.01
"""Of the simulation [s]; odometry comes every 2, commands every 5, scans every 10 ticks."""
ANGLES = np.linspace(-math.pi, math.pi, 72, endpoint=False)
"""Of the scan's beams [rad]."""


class Drive:
    """Drives a cart from a pose through a core at 20 Hz, by a planner's (v_x, v_y, ω).

    `given` are parameters; without a robot's, they are those of `CART`.
    """

    def __init__(
        self,
        given: Mapping[str, Any] | None = None,
        start: ArrayLike = (0.0, 0.0, 0.0),
        wanted: tuple[float, float, float] = (0.4, 0.0, 0.0),
    ):
        given = given or {}
        self.core = NodeCore(read({**({} if "robot" in given else CART), **given}))
        self.now = Now(1.7e9, 50.0)
        self.pose = np.array(start, dtype=np.float64)
        self.velocity: Array = np.zeros(len(self.core.step(self.now).nominal))
        self.motion: Array = np.zeros(2)  # as fast as its accelerations let it follow
        self.wanted, self.ticks = wanted, 0
        self.decisions: list[tuple[Now, Decision]] = []
        self.commands: list[Array] = []  # the base's after each decision
        self.speeds: list[float] = []  # of each tick [m/s]
        self.latencies: list[float] = []  # of the core's decisions [s]
        self.ranges: Array = np.full(ANGLES.size, np.inf)

    def run(
        self,
        seconds: float,
        *,
        odometry: bool = True,
        command: bool = True,
        scan: bool = True,
        clock: float = 1.0,
        each: Callable[[Self], Any] | None = None,
    ) -> Self:
        """Continue for so many seconds, with or without odometry, command and scan.

        `clock` is the speed of the node's clock; `each` is called in every tick.
        """
        for _ in range(round(seconds / TICK)):
            self._move()
            self.ticks += 1
            self.now = Now(self.now.ros + clock * TICK, self.now.steady + TICK)
            if odometry and self.ticks % 2 == 0:
                self.say_odometry()
            if scan and "scan" in self.core.sources and self.ticks % 10 == 0:
                self.say_scan()
            if command and self.ticks % 5 == 0:
                self.say_command(self.wanted)
            if each is not None:
                each(self)
            if self.ticks % 5 == 0:
                self._step()
        return self

    def _step(self) -> None:
        """Follow the core's decision; a base without a message retains its command."""
        begun = time.perf_counter()
        decision = self.core.step(self.now)
        self.latencies.append(time.perf_counter() - begun)
        self.decisions.append((self.now, decision))
        if decision.command is not None:
            self.velocity = decision.command
        self.commands.append(self.velocity)
        goal = self.core.goal_to_plan()
        if goal is not None:
            self.core.take(self.core.planned(goal))

    def _move(self) -> None:
        most = TICK * np.array(HARDEST)
        self.motion = self.motion + np.clip(self.velocity - self.motion, -most, most)
        v, w = self.motion
        self.speeds.append(abs(float(v)))
        yaw = self.pose[2]
        self.pose = self.pose + TICK * np.array([v * math.cos(yaw), v * math.sin(yaw), w])

    def stamp(self) -> float:
        """Return now on the node's clock [s]."""
        return self.now.ros

    def set_back(self, seconds: float) -> None:
        """Set the node's clock back."""
        self.now = Now(self.now.ros - seconds, self.now.steady)

    def say_command(self, wanted: ArrayLike, frame: str = "") -> None:
        """Let the core hear a command (3,)."""
        self.core.hear_command(wanted, self.now, self.now.ros, frame)

    def say_odometry(
        self,
        pose: ArrayLike | None = None,
        stamp: float | None = None,
        frame: str = "odom",
        twist: ArrayLike | None = None,
    ) -> None:
        """Let the core hear the odometry, or another."""
        motion = self.twist if twist is None else twist
        when = self.now.ros if stamp is None else stamp
        place = self.pose if pose is None else pose
        self.core.hear_odometry(place, motion, when, self.now, frame, "base_footprint")

    def say_scan(
        self,
        ranges: ArrayLike | None = None,
        stamp: float | None = None,
        frame: str = "base_footprint",
    ) -> None:
        """Let the core hear the scan, or another, as the node does."""
        when = self.now.ros if stamp is None else stamp
        far = self.ranges if ranges is None else ranges
        beams = Beams(far, -math.pi, math.tau / np.size(far), 0.05, 10.0)
        try:
            shown = self.core.of_scan("scan", beams)
        except InvalidInputError as error:
            self.core.refuse_source("scan", str(error))
            return
        self.core.hear_source("scan", shown, when, self.now, frame)

    @property
    def twist(self) -> ArrayLike:
        """(3,) of the odometry [m/s, rad/s]."""
        return self.motion[0], 0.0, self.motion[1]

    @property
    def last(self) -> Decision:
        """The newest decision."""
        return self.decisions[-1][1]
