"""Start the filter as a lifecycle node, and let it configure and activate itself."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return the node with its file of parameters."""
    usual = PathJoinSubstitution([FindPackageShare("hcbf_ros"), "config", "hcbf_filter.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", default_value=usual),
            DeclareLaunchArgument("use_sim_time", default_value="false"),
            Node(
                package="hcbf_ros",
                executable="hcbf_filter",
                name="hcbf_filter",
                output="screen",
                arguments=["--autostart"],
                parameters=[
                    LaunchConfiguration("params_file"),
                    {"use_sim_time": LaunchConfiguration("use_sim_time")},
                ],
            ),
        ]
    )
