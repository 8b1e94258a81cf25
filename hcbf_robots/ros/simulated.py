"""A simulated robot on a real one's topics: a walker in MuJoCo, odometry and a ray-cast scan.

It hears cmd_vel and publishes odom, scan and, with --map, the map and what of it is a mask. What
stands behind --ros-args is ROS's own.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hcbf_gym.arguments import Amount, Folder, Seed
from hcbf_gym.errors import require_packages
from hcbf_gym.records import make_folder
from hcbf_robots.maps import nav2
from hcbf_robots.ros.command import require_rclpy


@dataclass(frozen=True)
class Args:
    """What is simulated."""

    robot: str = "cart"
    """A contract's path, or a name: cart, holonomic-cart."""
    map: str = ""
    """A map server's YAML: seen by the scan and published on `map` [default: an empty floor]."""
    masks: tuple[str, ...] = ()
    """More of them, each published on the topic of its file's name."""
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x, y [m] and yaw [rad]."""
    noise: Amount = 0.01
    """Standard deviation of the scan's ranges [m]."""
    stamped: bool | None = None
    """Whether cmd_vel is TwistStamped [default: as the distribution has it]."""
    clock: Amount = 0.0
    """Above 0: publish /clock, and let it go so many times as fast as the wall's."""
    seed: Seed = 0
    """Of the noise."""
    path: Folder | None = None
    """At the end, write there (N, 4) time, x, y and yaw of every tick, a .npy."""


def main(args: Args) -> None:
    """Simulate until it is interrupted."""
    require_rclpy("hcbf ros-sim")
    require_packages("hcbf ros-sim", "mujoco")
    from hcbf_robots.ros import sim_node
    from hcbf_robots.ros.robot import SimulatedRobot

    robot = SimulatedRobot(args.robot, args.map, args.start, args.noise, seed=args.seed)
    grids = {"map": args.map} if args.map else {}
    grids |= {Path(mask).stem: mask for mask in args.masks}
    for file in grids.values():
        nav2.read(file)
    if args.path is not None:
        make_folder(args.path.parent)
    try:
        sim_node.spin(robot, grids, args.stamped, args.clock)
    finally:
        if args.path is not None:
            np.save(args.path, robot.timed_path())
