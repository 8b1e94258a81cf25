"""The node through real rclpy: planner, node and simulated robot in processes of their own.

One drive to a goal past a zone of rank 1, then silence, zones that come and go, the lifecycle and
both signals, on the loopback alone, within a minute. It needs the extra ros-wheels, or a sourced
ROS. Faults are in `live_faults`.
"""
# pyright: reportMissingImports=false

import math
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from lifecycle_msgs.msg import Transition
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool

from benchmarks.ros.rig import PERIOD, Base, Planner, ended, filtered, process
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import ConvexPolygon
from hcbf_robots.walkers import Walker

PATH = (0.0, 1.2, 3.4, 4.5), (0.0, 0.55, 0.55, 0.9)
"""x and y of the planner's path [m], past a zone, nearer than the cart is wide."""
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


def follows(pose: Array) -> tuple[float, float, float]:
    """Return the velocity along the path, as if nothing were there."""
    ahead = pose[0] + AHEAD
    away = np.array([ahead, np.interp(ahead, *PATH)]) - pose[:2]
    turn = math.remainder(math.atan2(away[1], away[0]) - pose[2], math.tau)
    return 0.8 * max(0.0, math.cos(turn)), 0.0, float(np.clip(2.0 * turn, -1.0, 1.0))


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
        planner.wants = lambda: follows(planner.pose)
        configured = planner.change(Transition.TRANSITION_CONFIGURE)
        planner.spin(60.0, lambda: planner.pose.any())
        planner.spin(0.5)
        silent = not planner.given and not planner.counts
        found["silent before it is active"] = "" if configured and silent else "publishes"
        planner.change(Transition.TRANSITION_ACTIVATE)
        begun = time.monotonic()
        arrived = planner.spin(20.0, lambda: math.dist(planner.pose[:2], GOAL) < NEAR)
        found["arrives"] = "" if arrived else f"stands at {planner.pose.round(2).tolist()}"
        print(f"   {time.monotonic() - begun:.1f} s to the goal")
        missing = {"diagnostics", "state", "markers", "report"} - planner.counts.keys()
        found["reports"] = f"no {sorted(missing)}" if missing else ""
        found["robot ends on SIGTERM"] = "" if ended(robot, signal.SIGTERM) else "does not"
        found["without odometry"] = planner.stops(0.2, "odometry")
    left = nearest(path)
    print(f"   {left:.3f} m between the cart's circle and the zone at least")
    found["rank 1 is not entered"] = "" if left >= 0.0 else f"by {-left:.3f} m"


def silence(planner: Planner, found: dict[str, str]) -> None:
    """Let a base of this process jump, and the planner fall silent; then it moves again."""
    planner.base = Base(planner)
    planner.base.pose = np.array([6.0, 3.0, 0.0])  # free, as far as a jump from where it was
    planner.wants = lambda: (0.3, 0.0, 0.4)  # round and round
    found["moves after a jump"] = moves(planner)
    planner.wants = None
    found["planner silent"] = planner.stops(0.25, "command")
    planner.spin(2.0)
    planner.given.clear()
    planner.spin(0.5)
    found["silent after stop_pub_timeout"] = "publishes" if planner.given else ""
    planner.wants = lambda: (0.3, 0.0, 0.4)
    found["publishes again"] = moves(planner)


def moves(planner: Planner) -> str:
    """Return "" if the node lets the robot move soon, else why not."""
    return "" if planner.spin(5.0, planner.moving) else f"stands: {planner.message}"


def zones(planner: Planner, found: dict[str, str]) -> None:
    """Let a zone of rank 2 come around the robot, and go; refuse an invalid one."""
    base = planner.base
    assert base is not None
    planner.wants = lambda: (0.0, 0.0, 0.0)
    planner.spin(0.5)
    around = np.array([(-0.4, -0.4), (0.4, -0.4), (0.4, 0.4), (-0.4, 0.4)]) + base.pose[:2]
    zone = ConvexPolygon("guest", 2, tuple(map(tuple, around.tolist())))
    planner.show(around)
    out = planner.spin(8.0, lambda: zone.jet(np.array([*base.pose[:2], 0.0, 0.0])).h > 0.0)
    found["drives out of a zone around it"] = "" if out else f"stands: {planner.message}"
    planner.wants = lambda: (0.3, 0.0, 0.4)
    planner.show(around[[0, 2, 1, 3]])  # crosses itself
    found["an invalid polygon"] = planner.stops(PERIOD, "guest")
    planner.show([])
    found["a zone that is gone"] = moves(planner)


def lifecycle(planner: Planner, node: subprocess.Popen[bytes], found: dict[str, str]) -> None:
    """Toggle, deactivate, refuse a parameter, and end on SIGINT while the robot moves."""
    planner.request(planner.toggle, SetBool.Request(data=False))
    planner.spin(0.5)
    passes = bool(planner.given) and planner.given[-1][1:] == (0.3, 0.4)
    planner.request(planner.toggle, SetBool.Request(data=True))
    found["toggle"] = "" if passes else "filters"
    planner.change(Transition.TRANSITION_DEACTIVATE)
    planner.spin(0.2)
    last = planner.given[-1][1:]
    planner.given.clear()
    planner.spin(0.5)
    wrong = "publishes" if planner.given else f"{last} last" if any(last) else ""
    found["deactivated: zero, then nothing"] = wrong
    planner.change(Transition.TRANSITION_CLEANUP)
    client = planner.create_client(SetParameters, "hcbf_filter/set_parameters")

    def configures(points: list[float]) -> bool:
        given = Parameter("zone.points", value=points).to_parameter_msg()
        planner.request(client, SetParameters.Request(parameters=[given]))
        return planner.change(Transition.TRANSITION_CONFIGURE)

    refused = not configures([0.0, 0.0, 1.0, 0.0])
    found["a wrong parameter fails configure"] = "" if refused else "configures"
    again = configures(np.ravel(CORNERS).tolist())
    again = planner.change(Transition.TRANSITION_ACTIVATE) and again
    found["configured again"] = moves(planner) if again else "is not"
    well = ended(node, signal.SIGINT)
    planner.spin(0.3)
    last = planner.given[-1][1:]
    found["ends on SIGINT with zero"] = "" if well and not any(last) else f"{last} last"


def main() -> int:
    """Run all, print what was found, and return how much of it is wrong."""
    begun, found = time.monotonic(), dict[str, str]()
    with filtered(PARAMETERS) as (planner, folder, node):
        try:
            drive(planner, folder, found)
            silence(planner, found)
            zones(planner, found)
            lifecycle(planner, node, found)
        finally:
            for log in sorted(folder.glob("*.log")):
                print(log.stem, log.read_text(encoding="utf-8"), sep=": ")
    for what, wrong in found.items():
        print(f"{what:36} {wrong or 'yes'}")
    print(f"{time.monotonic() - begun:.0f} s")
    return sum(map(bool, found.values()))


if __name__ == "__main__":
    sys.exit(main())
