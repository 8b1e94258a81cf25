"""The node that simulates a robot on the topics of a real one; it needs rclpy."""
# pyright: reportMissingImports=false
# rclpy comes with ROS, or with the extra ros-wheels

import math
import sys
import time
from typing import Any

import numpy as np
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import LaserScan

from hcbf_robots.maps import nav2
from hcbf_robots.ros import messages, running
from hcbf_robots.ros.robot import BEAMS, FARTHEST_BEAM, NEAREST_BEAM, SimulatedRobot
from hcbf_robots.ros.running import LATCHED, RELIABLE, SENSOR
from hcbf_robots.ros.settings import stamped_by_default

PERIOD = 0.02
"""Time between two messages of odometry [s]."""
PERIODS_PER_SCAN = 5
"""Periods of the odometry between two scans."""
MAX_PERIODS_BEHIND = 5
"""Most periods that are simulated at once; a slow machine lets the robot's time pass slower."""


class SimulatedRobotNode(Node):
    """Steps the robot in real time, and publishes its measurements.

    Args:
        robot: the robot that is stepped.
        grids: topic → file of each map and mask that is published.
    """

    def __init__(self, robot: SimulatedRobot, grids: dict[str, str]):
        super().__init__("hcbf_robot")
        self.robot = robot
        self._stamped = stamped_by_default()
        velocity_type = TwistStamped if self._stamped else Twist
        self.create_subscription(velocity_type, "cmd_vel", self._on_command, RELIABLE)
        self._odometry = self.create_publisher(Odometry, "odom", SENSOR)
        self._scan = self.create_publisher(LaserScan, "scan", SENSOR)
        self._grids = []
        for topic, file in grids.items():
            self._grids.append(self.create_publisher(OccupancyGrid, topic, LATCHED))
            self._grids[-1].publish(_grid(nav2.read(file), self._stamp()))
        self._began_at, self._periods = time.monotonic(), 0
        self.create_timer(PERIOD, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _stamp(self) -> Any:
        return self.get_clock().now().to_msg()

    def _on_command(self, message: Any) -> None:
        self.robot.command(messages.twist_of(message.twist if self._stamped else message))

    def _tick(self) -> None:
        """Simulate up to the present of the steady clock, and publish the measurements."""
        last, due = self._periods, int((time.monotonic() - self._began_at) / PERIOD)
        skipped = due - last - MAX_PERIODS_BEHIND
        if skipped > 0:
            self._began_at += skipped * PERIOD
            due -= skipped
        if due <= last:
            return
        self.robot.run(PERIOD * (due - last))
        self._periods = due
        if self.robot.fallen:
            self.get_logger().error("the robot has fallen", once=True)
        if self.robot.failed:
            self.get_logger().error(
                "its controller returned no action: the last is kept", once=True
            )
        stamp = self._stamp()
        self._odometry.publish(_odometry(self.robot, stamp))
        if last // PERIODS_PER_SCAN < due // PERIODS_PER_SCAN:
            self._scan.publish(_scan(self.robot, stamp))


def _odometry(robot: SimulatedRobot, stamp: Any) -> Odometry:
    message = Odometry(child_frame_id="base_footprint")
    message.header.stamp, message.header.frame_id = stamp, "odom"
    messages.write_pose(robot.pose, message.pose.pose)
    messages.write_twist(robot.twist, message.twist.twist)
    return message


def _scan(robot: SimulatedRobot, stamp: Any) -> LaserScan:
    message = LaserScan(
        angle_min=-math.pi,
        angle_max=math.pi - math.tau / BEAMS,
        angle_increment=math.tau / BEAMS,
        scan_time=PERIOD * PERIODS_PER_SCAN,
        range_min=NEAREST_BEAM,
        range_max=FARTHEST_BEAM,
        ranges=robot.scan().astype(np.float32).tolist(),
    )
    message.header.stamp, message.header.frame_id = stamp, "base_footprint"
    return message


def _grid(raster: nav2.Raster, stamp: Any) -> OccupancyGrid:
    message = OccupancyGrid()
    message.header.stamp, message.header.frame_id = stamp, "odom"
    info, grid = message.info, raster.grid
    info.resolution, (info.height, info.width) = grid.resolution, grid.shape
    messages.write_pose(np.array(grid.origin), info.origin)
    message.data = raster.occupancy.astype(np.int8).ravel().tolist()
    return message


def spin(*args: Any) -> None:
    """Simulate until a signal ends it; the arguments are those of `SimulatedRobotNode`."""
    running.run(lambda: SimulatedRobotNode(*args), sys.argv)
