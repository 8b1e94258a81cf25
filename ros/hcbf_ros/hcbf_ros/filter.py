"""The node, as `ros2 run hcbf_ros hcbf_filter` starts it: a lifecycle manager configures it."""

import sys

from hcbf_gym import cli


def main() -> None:
    """Run `hcbf ros` with what ROS gives to the process."""
    cli.main(["ros", *sys.argv[1:]])
