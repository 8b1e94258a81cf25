"""Processes of the node and of the simulated robot, and a planner beside them, through rclpy."""
# pyright: reportMissingImports=false

import contextlib
import math
import os
import subprocess
import sys
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
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import LaserScan
from std_srvs.srv import SetBool
from visualization_msgs.msg import MarkerArray

ALONE = {
    "ROS_LOCALHOST_ONLY": "1",
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
}
"""Nobody else hears these processes."""
PERIOD, SLACK = 0.05, 0.1
"""The node's, and what messages and a busy machine may take besides [s]."""


class Planner(Node):
    """Publishes what it wants, and remembers what the node says.

    Args:
        period: of what it publishes [s].

    Attributes:
        wants: (v, ω) now [m/s, rad/s]; None publishes nothing.
        told: (time on the steady clock, v, ω) of each message on cmd_vel.
        heard: called with each diagnostic.
    """

    def __init__(self, period: float = PERIOD) -> None:
        super().__init__("planner")
        self.wants: Callable[[], tuple[float, float]] | None = None
        self.frame = "base_footprint"
        self.told: list[tuple[float, float, float]] = []
        self.counts: dict[str, int] = {}
        self.heard: Callable[[str], Any] = str
        self.says, self.state, self.pose = "", "", np.zeros(3)
        self.base: Base | None = None
        self._velocity = self.create_publisher(TwistStamped, "cmd_vel_smoothed", 10)
        self._guest = self.create_publisher(PolygonStamped, "guest", 10)
        self.create_subscription(TwistStamped, "cmd_vel", self._on_told, 10)
        self.create_subscription(Odometry, "odom", self._on_odometry, qos_profile_sensor_data)
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

    def _on_told(self, message: Any) -> None:
        v, w = message.twist.linear.x, message.twist.angular.z
        self.told.append((time.monotonic(), v, w))
        if self.base is not None:
            self.base.velocity = v, w

    def _on_odometry(self, message: Any) -> None:
        at, turned = message.pose.pose.position, message.pose.pose.orientation
        self.pose = np.array([at.x, at.y, 2.0 * math.atan2(turned.z, turned.w)])

    def _on_diagnostics(self, message: Any) -> None:
        self._count("diagnostics")
        self.says = message.status[0].message
        self.heard(self.says)

    def _on_state(self, message: Any) -> None:
        self._count("state")
        self.state = message.value

    def _drive(self) -> None:
        if self.wants is not None:
            self.say(self.wants())

    def say(self, wanted: tuple[float, float]) -> None:
        """Publish a velocity."""
        message = TwistStamped()
        message.header.stamp, message.header.frame_id = self.stamp(), self.frame
        message.twist.linear.x, message.twist.angular.z = wanted
        self._velocity.publish(message)

    def spin(self, seconds: float, until: Callable[[], Any] = lambda: False) -> bool:
        """Go on for so long at most; return whether what was waited for has come."""
        ends = time.monotonic() + seconds
        while time.monotonic() < ends:
            if until():
                return True
            rclpy.spin_once(self, timeout_sec=0.01)
        return bool(until())

    def ask(self, client: Any, request: Any) -> Any:
        """Return what a service answers."""
        assert client.wait_for_service(30.0)
        answer = client.call_async(request)
        assert self.spin(60.0, answer.done)
        return answer.result()

    def change(self, transition: int) -> bool:
        """Change the node's state; return whether it did."""
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(self.ask(self._change, request).success)

    def show(self, corners: Any) -> None:
        """Let the guest come, move or go."""
        message = PolygonStamped()
        message.header.stamp, message.header.frame_id = self.stamp(), "odom"
        message.polygon.points = [Point32(x=float(x), y=float(y)) for x, y in corners]
        self._guest.publish(message)

    def moving(self) -> bool:
        """Return whether the last message on cmd_vel was recent, and no zero."""
        recent = bool(self.told) and self.told[-1][0] > time.monotonic() - 0.2
        return recent and any(self.told[-1][1:])

    def stops(self, within: float, reason: str) -> str:
        """Return "" where zero is told in time and stays, with its reason; else what was wrong."""
        begun = time.monotonic()
        self.spin(within + PERIOD + SLACK + 0.3)
        told = [one for one in self.told if one[0] > begun]
        zero = next((k for k, one in enumerate(told) if not any(one[1:])), None)
        if zero is None:
            return "never zero"
        late = told[zero][0] - begun
        if late > within + PERIOD + SLACK:
            return f"zero after {late:.2f} s"
        if any(any(one[1:]) for one in told[zero:]):
            return "moves again"
        return "" if reason in self.says else f"says {self.says!r}"


class Base:
    """Odometry and a free scan of a robot that does what it is told, in the planner's process.

    Args:
        node: that publishes.
        clock: where the robot's clock begins, which it publishes on /clock [s]; None: the wall's.

    Attributes:
        velocity: (v, ω) that it was told last.
        pose: x, y [m] and yaw [rad].
        odometry: whether it is published; `scan` likewise.
        tamper: called in every tick, to publish something else.
        rate: how fast its clock goes.
        longest: time between two ticks [s].
    """

    def __init__(self, node: Planner, clock: float | None = None):
        self._node, self.pose, self.velocity = node, node.pose.copy(), (0.0, 0.0)
        self.odometry = self.scan = True
        self.tamper: Callable[[], None] = lambda: None
        self.clock, self.rate, self.longest = clock, 1.0, 0.0
        self._odometry = node.create_publisher(Odometry, "odom", qos_profile_sensor_data)
        self._scan = node.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
        if clock is not None:
            self._clock = node.create_publisher(ClockMessage, "/clock", qos_profile_sensor_data)
        self._last, self.ticks = time.monotonic(), 0
        node.create_timer(0.02, self._tick)

    def stamp(self) -> Any:
        """Return now in ROS's form, on its clock."""
        if self.clock is None:
            return self._node.get_clock().now().to_msg()
        return Time(nanoseconds=round(1e9 * self.clock)).to_msg()

    def _tick(self) -> None:
        now, (v, w) = time.monotonic(), self.velocity
        seconds, self._last = now - self._last, now
        self.longest = max(self.longest, seconds)
        x, y, yaw = self.pose
        self.pose = np.array(
            [x + seconds * v * math.cos(yaw), y + seconds * v * math.sin(yaw), yaw + seconds * w]
        )
        self.ticks += 1
        if self.clock is not None:
            self.clock += self.rate * seconds
            self._clock.publish(ClockMessage(clock=self.stamp()))
        if self.odometry:
            self.say_odometry()
        if self.scan and self.ticks % 5 == 0:
            self.say_scan()
        self.tamper()

    def say_odometry(
        self, pose: Any = None, twist: Any = None, stamp: Any = None, frame: str = "odom"
    ) -> None:
        """Publish where it is, and (v, ω), or something else."""
        message = Odometry(child_frame_id="base_footprint")
        message.header.stamp, message.header.frame_id = stamp or self.stamp(), frame
        place, motion = message.pose.pose, message.twist.twist
        x, y, yaw = map(float, self.pose if pose is None else pose)
        place.position.x, place.position.y = x, y
        place.orientation.z, place.orientation.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
        motion.linear.x, motion.angular.z = self.velocity if twist is None else twist
        self._odometry.publish(message)

    def say_scan(
        self, far: float = math.inf, stamp: Any = None, frame: str = "base_footprint"
    ) -> None:
        """Publish a scan of which each beam has the same range [m]."""
        beams = scan_of(far)
        beams.header.stamp, beams.header.frame_id = stamp or self.stamp(), frame
        self._scan.publish(beams)


def scan_of(far: float) -> LaserScan:
    """Return a scan all around of which each beam has the same range [m]."""
    return LaserScan(angle_max=5.9, angle_increment=0.1, range_max=10.0, ranges=[far] * 60)


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
