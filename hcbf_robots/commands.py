"""The commands for robots, which the entry point `hcbf.commands` adds to `hcbf`."""

from hcbf_gym.arguments import Subcommand

COMMANDS = {
    "identify": Subcommand(
        "hcbf_robots.identification.command",
        "how a robot follows the velocities that it is commanded",
    ),
    "ros": Subcommand(
        "hcbf_robots.ros.command", "a ROS 2 node in the place of Nav2's collision monitor"
    ),
    "ros-sim": Subcommand(
        "hcbf_robots.ros.simulated", "a simulated robot on a real one's topics, for the node"
    ),
}
