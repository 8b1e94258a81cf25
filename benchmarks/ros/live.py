"""The node through real rclpy: planner, node and simulated robot in processes of their own.

    python -m benchmarks.ros.live

One drive to a goal past a zone of rank 1, then fault by fault, zones that come and go, the
lifecycle and both signals, on the loopback alone, within a minute. It needs the extra ros-wheels,
or a sourced ROS.
"""
# pyright: reportMissingImports=false

import contextlib
import math
import os
import signal
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
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from std_srvs.srv import SetBool
from visualization_msgs.msg import MarkerArray

from hcbf_gym.barriers import ConvexPolygon
from hcbf_gym.robots import Walker

ALONE = {
    "ROS_LOCALHOST_ONLY": "1",
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
}
"""Nobody else hears these processes."""
PATH = (0.0, 1.2, 3.4, 4.5), (0.0, 0.55, 0.55, 0.9)
"""x and y of what the planner follows: it leads past a zone, nearer than the cart is wide [m]."""
GOAL, NEAR, AHEAD = (4.5, 0.9), 0.35, 0.8
CORNERS = ((2.0, -1.3), (3.0, -1.3), (3.0, 0.3), (2.0, 0.3))
"""Of the zone [m]."""
PARAMETERS = """hcbf_filter:
  ros__parameters:
    robot: cart
    state_topic: hcbf_state
    observation_sources: [zone, guest, laser]
    zone: {type: polygon, points: [2.0, -1.3, 3.0, -1.3, 3.0, 0.3, 2.0, 0.3]}
    guest: {type: polygon, topic: guest, priority: 2}
    laser: {type: scan, topic: scan, source_timeout: 0.5}
"""
PERIOD, SLACK = 0.05, 0.1
"""The node's, and what messages and a busy machine may take besides [s]."""


class Planner(Node):
    """Publishes what it wants, and remembers what the node says.

    Attributes:
        wants: (v, ω) now [m/s, rad/s]; None publishes nothing.
        told: (time on the steady clock, v, ω) of each message on cmd_vel.
    """

    def __init__(self) -> None:
        super().__init__("planner")
        self.wants: Callable[[], tuple[float, float]] | None = None
        self.frame = "base_footprint"
        self.told: list[tuple[float, float, float]] = []
        self.counts: dict[str, int] = {}
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
        self.create_timer(PERIOD, self._drive)

    def stamp(self) -> Any:
        """Return now in ROS's form."""
        return self.get_clock().now().to_msg()

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

    def _on_state(self, message: Any) -> None:
        self._count("state")
        self.state = message.value

    def _drive(self) -> None:
        if self.wants is None:
            return
        message = TwistStamped()
        message.header.stamp, message.header.frame_id = self.stamp(), self.frame
        message.twist.linear.x, message.twist.angular.z = self.wants()
        self._velocity.publish(message)

    def follows(self) -> tuple[float, float]:
        """Return the velocity along the path, as if nothing were there."""
        ahead = self.pose[0] + AHEAD
        away = np.array([ahead, np.interp(ahead, *PATH)]) - self.pose[:2]
        turn = math.remainder(math.atan2(away[1], away[0]) - self.pose[2], math.tau)
        return 0.8 * max(0.0, math.cos(turn)), float(np.clip(2.0 * turn, -1.0, 1.0))

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

    Attributes:
        velocity: (v, ω) that it was told last.
        pose: x, y [m] and yaw [rad].
        odometry: whether it is published; `scan` likewise.
        broken: whether its twist is NaN.
    """

    def __init__(self, node: Planner):
        self._node, self.pose, self.velocity = node, node.pose.copy(), (0.0, 0.0)
        self.odometry = self.scan = True
        self.broken = False
        self._odometry = node.create_publisher(Odometry, "odom", qos_profile_sensor_data)
        self._scan = node.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
        self._last, self._ticks = time.monotonic(), 0
        node.create_timer(0.02, self._tick)

    def _tick(self) -> None:
        now, (v, w) = time.monotonic(), self.velocity
        seconds, self._last = now - self._last, now
        x, y, yaw = self.pose
        self.pose = np.array(
            [x + seconds * v * math.cos(yaw), y + seconds * v * math.sin(yaw), yaw + seconds * w]
        )
        self._ticks += 1
        if self.odometry:
            message = Odometry(child_frame_id="base_footprint")
            message.header.stamp, message.header.frame_id = self._node.stamp(), "odom"
            place, motion = message.pose.pose, message.twist.twist
            place.position.x, place.position.y = float(self.pose[0]), float(self.pose[1])
            place.orientation.z = math.sin(0.5 * self.pose[2])
            place.orientation.w = math.cos(0.5 * self.pose[2])
            motion.linear.x, motion.angular.z = math.nan if self.broken else v, w
            self._odometry.publish(message)
        if self.scan and self._ticks % 5 == 0:
            beams = LaserScan(angle_increment=0.1, range_max=10.0, ranges=[math.inf] * 60)
            beams.header.stamp, beams.header.frame_id = self._node.stamp(), "base_footprint"
            self._scan.publish(beams)


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


def nearest(path: Path) -> float:
    """Return how near the cart's circle came to the zone [m]; below 0 it was inside."""
    zone = ConvexPolygon("zone", 1, CORNERS)
    places = np.load(path)[:, 1:3]
    reach = Walker.load("cart").reach
    return min(float(zone.jet(np.array([x, y, 0.0, 0.0])).h) for x, y in places) - reach


def drive(planner: Planner, folder: Path, found: dict[str, str]) -> None:
    """Configure, activate, and drive to the goal; then the robot's process ends."""
    path = folder / "path.npy"
    with process(folder, "robot", "ros-sim", "--robot", "cart", "--path", str(path)) as robot:
        planner.wants = planner.follows
        configured = planner.change(Transition.TRANSITION_CONFIGURE)
        planner.spin(60.0, lambda: planner.pose.any())
        planner.spin(0.5)
        silent = not planner.told and not planner.counts
        found["silent before it is active"] = "" if configured and silent else "speaks"
        planner.change(Transition.TRANSITION_ACTIVATE)
        begun = time.monotonic()
        arrived = planner.spin(20.0, lambda: math.dist(planner.pose[:2], GOAL) < NEAR)
        found["arrives"] = "" if arrived else f"stands at {planner.pose.round(2).tolist()}"
        print(f"   {time.monotonic() - begun:.1f} s to the goal")
        missing = {"diagnostics", "state", "markers", "report"} - planner.counts.keys()
        found["says what it does"] = f"no {sorted(missing)}" if missing else ""
        found["robot ends on SIGTERM"] = "" if ended(robot, signal.SIGTERM) else "does not"
        found["without odometry"] = planner.stops(0.2, "odometry")
    left = nearest(path)
    print(f"   {left:.3f} m between the cart's circle and the zone at least")
    found["rank 1 is not entered"] = "" if left >= 0.0 else f"by {-left:.3f} m"


def faults(planner: Planner, found: dict[str, str]) -> None:
    """Let faults happen to odometry, scan and command; each time it goes on by itself."""
    base = planner.base = Base(planner)
    base.pose = np.array([6.0, 3.0, 0.0])  # free, as far as a jump from where it was
    planner.wants = wants = lambda: (0.3, 0.4)  # round and round

    def goes_on() -> str:
        return "" if planner.spin(5.0, planner.moving) else f"stands: {planner.says}"

    found["after a jump it goes on"] = goes_on()

    def happens(name: str, within: float, reason: str, owner: Any, **changes: Any) -> None:
        before = {key: getattr(owner, key) for key in changes}
        for key, value in changes.items():
            setattr(owner, key, value)
        wrong = planner.stops(within, reason)
        for key, value in before.items():
            setattr(owner, key, value)
        found[name] = wrong or goes_on()

    happens("odometry missing", 0.2, "odometry", base, odometry=False)
    happens("odometry NaN", 0.02, "odometry: got", base, broken=True)
    happens("scan missing", 0.6, "laser", base, scan=False)
    happens("command NaN", PERIOD, "command: got", planner, wants=lambda: (math.nan, 0.0))
    happens("command in a wrong frame", PERIOD, "command: frame 'map'", planner, frame="map")
    happens("planner silent", 0.25, "command", planner, wants=None)
    planner.wants = None
    planner.spin(2.0)
    planner.told.clear()
    planner.spin(0.5)
    found["silent after stop_pub_timeout"] = "speaks" if planner.told else ""
    planner.wants = wants
    found["speaks again"] = goes_on()


def zones(planner: Planner, found: dict[str, str]) -> None:
    """Let a zone of rank 2 come around the robot, and go; refuse one that is none."""
    base = planner.base
    assert base is not None
    planner.wants = lambda: (0.0, 0.0)
    planner.spin(0.5)
    around = np.array([(-0.4, -0.4), (0.4, -0.4), (0.4, 0.4), (-0.4, 0.4)]) + base.pose[:2]
    zone = ConvexPolygon("guest", 2, tuple(map(tuple, around.tolist())))
    planner.show(around)
    out = planner.spin(8.0, lambda: zone.jet(np.array([*base.pose[:2], 0.0, 0.0])).h > 0.0)
    found["drives out of a zone around it"] = "" if out else f"stands: {planner.says}"
    planner.wants = lambda: (0.3, 0.4)
    planner.show(around[[0, 2, 1, 3]])  # crosses itself
    found["a polygon that is none"] = planner.stops(PERIOD, "guest")
    planner.show([])
    gone = planner.spin(5.0, planner.moving)
    found["a zone that is gone"] = "" if gone else f"stands: {planner.says}"


def lifecycle(planner: Planner, node: subprocess.Popen[bytes], found: dict[str, str]) -> None:
    """Toggle, deactivate, refuse a bent parameter, and end on SIGINT while the robot moves."""
    planner.ask(planner.toggle, SetBool.Request(data=False))
    planner.spin(0.5)
    passes = bool(planner.told) and planner.told[-1][1:] == (0.3, 0.4)
    planner.ask(planner.toggle, SetBool.Request(data=True))
    found["toggle"] = "" if passes else "does not pass commands on"
    planner.change(Transition.TRANSITION_DEACTIVATE)
    planner.spin(0.2)
    last = planner.told[-1][1:]
    planner.told.clear()
    planner.spin(0.5)
    wrong = "speaks" if planner.told else f"told {last} last" if any(last) else ""
    found["deactivated: zero, then nothing"] = wrong
    planner.change(Transition.TRANSITION_CLEANUP)
    client = planner.create_client(SetParameters, "hcbf_filter/set_parameters")

    def configures(points: list[float]) -> bool:
        given = Parameter("zone.points", value=points).to_parameter_msg()
        planner.ask(client, SetParameters.Request(parameters=[given]))
        return planner.change(Transition.TRANSITION_CONFIGURE)

    refused = not configures([0.0, 0.0, 1.0, 0.0])
    found["a bent parameter fails configure"] = "" if refused else "configures"
    again = configures(np.ravel(CORNERS).tolist())
    again = planner.change(Transition.TRANSITION_ACTIVATE) and again
    moves = planner.spin(5.0, planner.moving)
    found["configured again"] = "" if again and moves else f"stands: {planner.says}"
    well = ended(node, signal.SIGINT)
    planner.spin(0.3)
    last = planner.told[-1][1:]
    found["ends on SIGINT, zero told"] = "" if well and not any(last) else f"told {last} last"


def main() -> int:
    """Run all, print what was found, and return how much of it is wrong."""
    begun, found = time.monotonic(), dict[str, str]()
    os.environ.update(ALONE)
    rclpy.init()
    planner = Planner()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "filter.yaml").write_text(PARAMETERS, encoding="utf-8")
        with process(folder, "node", "ros", "--params", str(folder / "filter.yaml")) as node:
            try:
                drive(planner, folder, found)
                faults(planner, found)
                zones(planner, found)
                lifecycle(planner, node, found)
            finally:
                for log in sorted(folder.glob("*.log")):
                    print(log.stem, log.read_text(encoding="utf-8"), sep=": ")
    planner.destroy_node()
    rclpy.try_shutdown()
    for what, wrong in found.items():
        print(f"{what:36} {wrong or 'yes'}")
    print(f"{time.monotonic() - begun:.0f} s")
    return sum(map(bool, found.values()))


if __name__ == "__main__":
    sys.exit(main())
