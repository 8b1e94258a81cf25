"""Processes of the node and of the simulated robot, and a planner beside them, through rclpy."""
# pyright: reportMissingImports=false

import contextlib
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, KeyValue
from geometry_msgs.msg import Point32, PolygonStamped, TwistStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.node import Node
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import LaserScan
from std_srvs.srv import SetBool
from visualization_msgs.msg import MarkerArray

from hcbf_gym.arrays import Array
from hcbf_robots.ros import messages
from hcbf_robots.ros.running import LATCHED, SENSOR

ALONE = {
    "ROS_LOCALHOST_ONLY": "1",
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
}
"""No other process hears these."""
PERIOD, SLACK = 0.05, 0.1
"""The node's, and what messages and a busy machine may take besides [s]."""


class Planner(Node):
    """Publishes commands at a period [s], and remembers the node's messages."""

    def __init__(self, period: float = PERIOD) -> None:
        super().__init__("planner")
        # (v_x, v_y, ω) now [m/s, rad/s]; None publishes nothing
        self.wants: Callable[[], tuple[float, float, float]] | None = None
        # (time on the steady clock, v, ω) of each message on cmd_vel
        self.given: list[tuple[float, float, float]] = []
        self.counts: dict[str, int] = {}
        self.heard: Callable[[str], Any] = str  # called with each diagnostic
        self.message, self.state, self.pose = "", "", np.zeros(3)
        self.base: Base | None = None
        self._velocity = self.create_publisher(TwistStamped, "cmd_vel_smoothed", 10)
        self._guest = self.create_publisher(PolygonStamped, "guest", 10)
        self.create_subscription(TwistStamped, "cmd_vel", self._on_velocity, 10)
        self.create_subscription(Odometry, "odom", self._on_odometry, SENSOR)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self.create_subscription(KeyValue, "hcbf_state", self._on_state, 10)
        for kind, topic in ((MarkerArray, "markers"), (DiagnosticArray, "report")):
            whole = f"hcbf_filter/{topic}"
            self.create_subscription(kind, whole, partial(self._count, topic), 10)
        self._change = self.create_client(ChangeState, "hcbf_filter/change_state")
        self.toggle = self.create_client(SetBool, "hcbf_filter/toggle")
        self.create_timer(period, self._drive)

    def stamp(self) -> Any:
        """Return now in ROS's form, on the robot's clock."""
        return self.get_clock().now().to_msg() if self.base is None else self.base.stamp()

    def _count(self, name: str, message: Any = None) -> None:
        self.counts[name] = self.counts.get(name, 0) + 1

    def _on_velocity(self, message: Any) -> None:
        v, w = message.twist.linear.x, message.twist.angular.z
        self.given.append((time.monotonic(), v, w))
        if self.base is not None:
            self.base.velocity = v, w

    def _on_odometry(self, message: Any) -> None:
        self.pose = messages.pose_of(message.pose.pose)

    def _on_diagnostics(self, message: Any) -> None:
        self._count("diagnostics")
        self.message = message.status[0].message
        self.heard(self.message)

    def _on_state(self, message: Any) -> None:
        self._count("state")
        self.state = message.value

    def _drive(self) -> None:
        if self.wants is not None and (self.base is None or self.base.without != "command"):
            self.say(self.wants())

    def say(self, wanted: Any, frame: str = "base_footprint") -> None:
        """Publish a velocity (3,)."""
        message = TwistStamped()
        message.header.stamp, message.header.frame_id = self.stamp(), frame
        messages.write_twist(wanted, message.twist)
        self._velocity.publish(message)

    def spin(self, seconds: float, until: Callable[[], Any] = lambda: False) -> bool:
        """Continue for so long at most; return whether `until` holds."""
        ends = time.monotonic() + seconds
        while time.monotonic() < ends:
            if until():
                return True
            rclpy.spin_once(self, timeout_sec=0.01)
        return bool(until())

    def request(self, client: Any, request: Any) -> Any:
        """Return a service's answer."""
        assert client.wait_for_service(30.0)
        answer = client.call_async(request)
        assert self.spin(60.0, answer.done)
        return answer.result()

    def change(self, transition: int) -> bool:
        """Change the node's state; return whether it did."""
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(self.request(self._change, request).success)

    def show(self, corners: Any) -> None:
        """Let the guest come, move or go."""
        message = PolygonStamped()
        message.header.stamp, message.header.frame_id = self.stamp(), "odom"
        message.polygon.points = [Point32(x=float(x), y=float(y)) for x, y in corners]
        self._guest.publish(message)

    def moving(self) -> bool:
        """Return whether the last message on cmd_vel was recent, and not zero."""
        recent = bool(self.given) and self.given[-1][0] > time.monotonic() - 0.2
        return recent and any(self.given[-1][1:])

    def stops(self, within: float, reason: str) -> str:
        """Return "" where zero comes in time and remains, with its reason; else what was wrong."""
        begun = time.monotonic()
        self.spin(within + PERIOD + SLACK + 0.3)
        given = [one for one in self.given if one[0] > begun]
        zero = next((k for k, one in enumerate(given) if not any(one[1:])), None)
        if zero is None:
            return "never zero"
        late = given[zero][0] - begun
        if late > within + PERIOD + SLACK:
            return f"zero after {late:.2f} s"
        if any(any(one[1:]) for one in given[zero:]):
            return "moves again"
        return "" if reason in self.message else f"reports {self.message!r}"


class Base:
    """Odometry, a free scan and an empty map of a robot that follows commands (a `faults.Rig`).

    `clock` is where the robot's clock begins, which it publishes on /clock [s]; None: the wall's.
    """

    def __init__(self, planner: Planner, clock: float | None = None):
        self.planner, self.pose, self.velocity = planner, planner.pose.copy(), (0.0, 0.0)
        self.without = ""  # the missing messages: "odometry", "scan", "map" or "command"
        self.tamper: Callable[[], Any] = lambda: None  # publishes something else in every tick
        self.clock, self.rate, self.longest = clock, 1.0, 0.0  # rate: of the clock
        self._odometry = planner.create_publisher(Odometry, "odom", SENSOR)
        self._scan = planner.create_publisher(LaserScan, "scan", SENSOR)
        if clock is not None:
            self._clock = planner.create_publisher(ClockMessage, "/clock", SENSOR)
            self._map = planner.create_publisher(OccupancyGrid, "map", LATCHED)
        self._last, self.ticks = time.monotonic(), 0
        planner.create_timer(0.02, self._tick)

    def stamp(self) -> Any:
        """Return now in ROS's form, on its clock."""
        if self.clock is None:
            return self.planner.get_clock().now().to_msg()
        return Time(nanoseconds=round(1e9 * self.clock)).to_msg()

    def set_back(self, seconds: float) -> None:
        """Set its clock back."""
        assert self.clock is not None
        self.clock -= seconds

    @property
    def twist(self) -> tuple[float, float, float]:
        """(3,) of the odometry [m/s, rad/s]."""
        return self.velocity[0], 0.0, self.velocity[1]

    @property
    def wanted(self) -> tuple[float, float, float]:
        """(3,) the planner's command [m/s, rad/s]."""
        return (0.0, 0.0, 0.0) if self.planner.wants is None else self.planner.wants()

    def _tick(self) -> None:
        now, (v, w) = time.monotonic(), self.velocity
        seconds, self._last = now - self._last, now
        self.longest = max(self.longest, seconds)
        yaw = self.pose[2]
        self.pose = self.pose + seconds * np.array([v * math.cos(yaw), v * math.sin(yaw), w])
        self.ticks += 1
        if self.clock is not None:
            self.clock += self.rate * seconds
            self._clock.publish(ClockMessage(clock=self.stamp()))
            if self.without != "map" and self.ticks % 15 == 0:
                self._say_map()
        if self.without != "odometry":
            self.say_odometry()
        if self.without != "scan" and self.ticks % 5 == 0:
            self.say_scan()
        self.tamper()

    def say_command(self, wanted: Any, frame: str = "base_footprint") -> None:
        """Publish a command (3,)."""
        self.planner.say(wanted, frame)

    def say_odometry(
        self, pose: Any = None, stamp: Any = None, frame: str = "odom", twist: Any = None
    ) -> None:
        """Publish pose and twist (3,), or others."""
        message = Odometry(child_frame_id="base_footprint")
        message.header.stamp, message.header.frame_id = stamp or self.stamp(), frame
        messages.write_pose(np.asarray(self.pose if pose is None else pose), message.pose.pose)
        messages.write_twist(
            np.asarray(self.twist if twist is None else twist), message.twist.twist
        )
        self._odometry.publish(message)

    def say_scan(
        self, ranges: Any = None, stamp: Any = None, frame: str = "base_footprint"
    ) -> None:
        """Publish a scan that sees nothing, or another."""
        beams = scan_of(np.full(60, np.inf) if ranges is None else ranges)
        beams.header.stamp, beams.header.frame_id = stamp or self.stamp(), frame
        self._scan.publish(beams)

    def _say_map(self) -> None:
        message = OccupancyGrid(data=[0] * 40_000)
        message.header.stamp, message.header.frame_id = self.stamp(), "odom"
        message.info.resolution, message.info.width, message.info.height = 0.1, 200, 200
        message.info.origin.position.x = message.info.origin.position.y = -10.0
        self._map.publish(message)


def scan_of(ranges: Array) -> LaserScan:
    """Return a scan all around of such ranges [m]."""
    last = 0.1 * (len(ranges) - 1)
    return LaserScan(angle_max=last, angle_increment=0.1, range_max=10.0, ranges=ranges.tolist())


@contextlib.contextmanager
def filtered(parameters: str) -> Iterator[tuple[Planner, Path, subprocess.Popen[bytes]]]:
    """Yield a planner, a folder, and the process of a node with such parameters, beside it."""
    os.environ.update(ALONE)
    rclpy.init()
    planner = Planner()
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "filter.yaml"
        file.write_text(parameters, encoding="utf-8")
        with process(file.parent, "node", "ros", "--params", str(file)) as node:
            yield planner, file.parent, node
    planner.destroy_node()
    rclpy.try_shutdown()


@contextlib.contextmanager
def process(folder: Path, name: str, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run a command of `hcbf` beside this process; it is killed if it does not end."""
    with open(folder / f"{name}.log", "wb") as log:
        command = [sys.executable, "-m", "hcbf_gym.cli", *words]
        running = subprocess.Popen(command, stdout=log, stderr=log)
        try:
            yield running
        finally:
            if running.poll() is None:
                running.kill()
            running.wait()


def ended(running: subprocess.Popen[bytes], number: int) -> bool:
    """Return whether a process ends soon and well after a signal."""
    running.send_signal(number)
    try:
        return running.wait(5.0) == 0
    except subprocess.TimeoutExpired:
        return False
