"""How long a command takes from its arrival to its publication, through real rclpy.

    python -m benchmarks.ros.latency [minutes] [hostile] [robot]

Commands at 50 Hz, Nav2's depot ($HCBF_DATA/maps/depot.yaml) and a scan of 360 beams at 10 Hz: a
planner without a map drives to and fro across it, and guidance leads; or a hostile one drives at
the nearest obstacle. The node is `hcbf ros` in another process, which also notes the jobs of its
other threads; the simulated robot's path is judged by the map's true squares.
"""
# pyright: reportMissingImports=false

import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.judges.squares import distances
from benchmarks.ros import errands
from benchmarks.ros.ride import pursuit
from hcbf_gym.arrays import Array
from hcbf_robots.maps import nav2
from hcbf_robots.ros.command import ros_arguments
from hcbf_robots.walkers import Walker

START, GOALS = (3.5, 7.5, 0.0), ((20.0, 7.5), (3.5, 7.5))
"""Through the depot and back [m]."""
PARAMETERS = """hcbf_filter:
  ros__parameters:
    robot: ROBOT
    guidance: "GUIDANCE"
    observation_sources: [walls, laser]
    walls: {type: map, topic: map, unknown: 1}
    laser: {type: scan, topic: scan}
"""
SETTLED = 5.0
"""From then on it counts [s]: the map has come, and the first goal."""


def node(parameters: Path, notes: Path) -> None:
    """Run the node, and write when commands came, how long they took, and which jobs ran."""
    from hcbf_robots.ros import node as nodes
    from hcbf_robots.ros import reporting, worker

    found: dict[str, list[Any]] = {"taken": [], "own": [], "spans": []}
    note, put, heard = reporting.Reporter.note, worker.Worker.put, nodes.FilterNode._on_command
    begun = [0.0]

    def noted(self: Any, latency: float) -> None:
        found["own"].append(time.thread_time() - begun[0])
        found["taken"].append((time.perf_counter(), latency))
        note(self, latency)

    def watched(self: Any, message: Any) -> None:
        begun[0] = time.thread_time()
        heard(self, message)

    def timed(self: Any, name: str, job: Callable[[], None]) -> None:
        def whole() -> None:
            since = time.perf_counter()
            try:
                job()
            finally:
                found["spans"].append((name, since, time.perf_counter()))

        put(self, name, whole)

    reporting.Reporter.note, worker.Worker.put = noted, timed  # type: ignore[method-assign]
    nodes.FilterNode._on_command = watched  # type: ignore[method-assign]
    sys.argv = sys.argv[:1]
    nodes.spin(ros_arguments(parameters), autostart=True)
    notes.write_text(json.dumps(found), encoding="utf-8")


def main(minutes: float, robot: str, *, friendly: bool) -> None:
    """Run planner, robot and node for so long, and print what was found."""
    import rclpy

    from benchmarks.ros.rig import ALONE, Planner, ended, process

    os.environ.update(ALONE)
    rclpy.init()
    planner = Planner(0.02)
    depot = Path(os.environ["HCBF_DATA"]) / "maps" / "depot.yaml"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parameters, notes = folder / "filter.yaml", folder / "notes.json"
        given = PARAMETERS.replace("GUIDANCE", "geodesic" if friendly else "")
        parameters.write_text(given.replace("ROBOT", robot), encoding="utf-8")
        path = folder / "path.npy"
        words = ["ros-sim", "--robot", robot, "--map", str(depot), "--start", *map(str, START)]
        words += ["--path", str(path)]
        command = [sys.executable, "-m", "benchmarks.ros.latency", str(parameters), str(notes)]
        with process(folder, "robot", *words) as simulated:
            running = subprocess.Popen(command)
            watched = Watched(running.pid)
            if friendly:
                _lead(planner, watched, 60.0 * minutes)
            else:
                plan = errands.hostile(errands.Room(depot, 0))
                planner.wants = _turning(plan, planner)
                assert planner.spin(120.0, planner.moving)
                planner.spin(60.0 * minutes, watched.look)
            running.send_signal(signal.SIGINT)
            running.wait(20.0)
            ended(simulated, signal.SIGTERM)
        _judge(np.load(path)[:, 1:3], depot, Walker.load(robot).reach)
        found = json.loads(notes.read_text("utf-8"))
    planner.destroy_node()
    rclpy.try_shutdown()
    loads = watched.loads
    print(f"load {np.median(loads):.1f} in the median, {max(loads):.1f} at most")
    print(f"the node's last message: {planner.message}")
    _show(found, watched.sizes)


class Watched:
    """The memory of a process [MB] and the machine's load, once a second.

    Args:
        process: its number.
    """

    def __init__(self, process: int):
        self._process, self._next = process, time.monotonic()
        self.sizes: list[float] = []
        self.loads = [os.getloadavg()[0]]

    def look(self) -> bool:
        """Look where a second has passed; return False."""
        if time.monotonic() >= self._next:
            self._next += 1.0
            self.sizes.append(_resident(self._process))
            self.loads.append(os.getloadavg()[0])
        return False


def _lead(planner: Any, watched: Watched, seconds: float) -> None:
    """Let the robot go to and fro between the goals for so long, and print how often it did."""
    from geometry_msgs.msg import PoseStamped

    goals = planner.create_publisher(PoseStamped, "goal_pose", 10)
    assert planner.spin(120.0, lambda: goals.get_subscription_count() > 0)
    ends, legs, arrived = time.monotonic() + seconds, 0, 0
    while time.monotonic() < ends:
        goal = GOALS[legs % 2]
        legs += 1
        message = PoseStamped()
        message.header.frame_id = "odom"
        message.pose.position.x, message.pose.position.y = goal
        planner.wants = _turning(pursuit([goal], 0.8), planner)
        goals.publish(message)

        def is_there(goal: tuple[float, float] = goal) -> bool:
            watched.look()
            return math.dist(planner.pose[:2], goal) <= 0.4

        arrived += planner.spin(min(90.0, ends - time.monotonic()), is_there)
    print(f"{arrived} of {legs} legs (the last is under way)")


def _turning(plan: Any, planner: Any) -> Callable[[], tuple[float, float]]:
    """Return what a plan wants of a differential drive now, (v, ω)."""

    def wants() -> tuple[float, float]:
        ahead, _, turn = plan(planner.pose)
        return ahead, turn

    return wants


def _judge(places: Array, file: Path, reach: float) -> None:
    """Print how near the robot's circle [m] came to the true cells of rank 1."""
    raster = nav2.read(file)
    apart = distances(raster.grid, raster.occupancy != nav2.FREE, places, 2.0)
    apart -= reach
    length = np.hypot(*np.diff(places, axis=0).T).sum()
    print(f"{length:.0f} m, rank 1 entered in {(apart < 0.0).sum()} of {apart.size} ticks, "
          f"{apart.min():+.3f} m at least")  # fmt: skip


def _resident(process: int) -> float:
    """Return the resident memory of a process [MB]."""
    for line in Path(f"/proc/{process}/status").read_text("utf-8").splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024.0
    return math.nan


def _show(found: dict[str, Any], sizes: list[float]) -> None:
    """Print the distribution, the longest with the jobs beside them, and the memory."""
    ends, taken = np.array(found["taken"]).T
    first, settled = ends[0], ends > ends[0] + SETTLED
    ends, taken, own = ends[settled], 1e3 * taken[settled], 1e3 * np.array(found["own"])[settled]
    for what, times in (("latency", taken), ("its thread's own time", own)):
        half, almost = np.quantile(times, [0.5, 0.99])
        print(f"{what} of {times.size} commands: median {half:.2f} ms, 99 % {almost:.2f} ms, "
              f"longest {times.max():.2f} ms")  # fmt: skip
    for k in np.argsort(taken)[:-6:-1]:
        begun, end = ends[k] - 1e-3 * taken[k], ends[k]
        beside = {
            name for name, since, until in found["spans"] if since < end and until > begun
        }  # fmt: skip
        print(f"  {taken[k]:.2f} ms, {own[k]:.2f} of them its own, at {end - first:.1f} s, beside "
              f"{sorted(beside) or 'nothing'}")  # fmt: skip
    for what in ("laser", "walls", "field"):
        spans = [1e3 * (until - since) for name, since, until in found["spans"] if name == what]
        if spans:
            print(f"  {what}: {len(spans)} times, median {np.median(spans):.1f}, "
                  f"longest {max(spans):.1f} ms")  # fmt: skip
    tenth = max(1, len(sizes) // 10)
    print(f"memory: {np.mean(sizes[tenth : 2 * tenth]):.1f} MB in the second tenth, "
          f"{np.mean(sizes[-tenth:]):.1f} MB in the last")  # fmt: skip


if __name__ == "__main__":
    if sys.argv[1:] and Path(sys.argv[1]).suffix == ".yaml":
        node(Path(sys.argv[1]), Path(sys.argv[2]))
    else:
        words = [word for word in sys.argv[1:] if word != "hostile"]
        main(float(words[0]) if words else 10.0, words[1] if words[1:] else "cart",
             friendly="hostile" not in sys.argv)  # fmt: skip
