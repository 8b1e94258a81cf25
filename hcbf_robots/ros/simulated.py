"""A simulated robot on a real one's topics: a walker in MuJoCo, odometry and a ray-cast scan.

It subscribes to cmd_vel and publishes odom, scan and, with --map, the map and masks. Arguments
behind --ros-args are ROS's own.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hcbf_gym.arguments import Folder
from hcbf_gym.errors import InvalidInputError, require_packages
from hcbf_gym.records import make_folder
from hcbf_robots.maps import nav2
from hcbf_robots.ros.command import require_rclpy


@dataclass(frozen=True)
class Args:
    """Options of the command."""

    robot: str = "cart"
    """A contract's path, or a name: cart, holonomic-cart."""
    map: str = ""
    """A map server's YAML: seen by the scan and published on `map` [default: an empty floor]."""
    masks: tuple[str, ...] = ()
    """Such files of masks, published on topics with the names of the files."""
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x, y [m] and yaw [rad]."""
    path: Folder | None = None
    """At the end, write there (N, 4) time, x, y and yaw of every tick, a .npy."""


def main(args: Args) -> None:
    """Simulate until it is interrupted."""
    require_rclpy("hcbf ros-sim")
    require_packages("hcbf ros-sim", "mujoco")
    from hcbf_robots.ros import sim_node
    from hcbf_robots.ros.robot import SimulatedRobot

    robot = SimulatedRobot(args.robot, args.map, args.start)
    grids = {"map": args.map} if args.map else {}
    for mask in args.masks:
        if grids.setdefault(Path(mask).stem, mask) != mask:
            raise InvalidInputError(
                f"masks: got {mask}, whose topic is that of {grids[Path(mask).stem]}, expected "
                "files of different names"
            )
    for file in grids.values():
        nav2.read(file)
    if args.path is not None:
        make_folder(args.path.parent)
    try:
        sim_node.spin(robot, grids)
    finally:
        if args.path is not None:
            np.save(args.path, robot.timed_path())
