"""The simulated robot's node; it needs rclpy."""
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
"""Of the odometry [s]."""
SCAN_EVERY = 5
"""Odometry messages between two scans."""
BEHIND = 5
"""Periods that it catches up at once at most; on a slower machine its time is slower."""


class SimulatedRobotNode(Node):
    """Steps the robot in real time, and publishes its measurements.

    Args:
        robot: to step.
        grids: topic → file of each map and mask that it publishes.
    """

    def __init__(self, robot: SimulatedRobot, grids: dict[str, str]):
        super().__init__("hcbf_robot")
        self.robot = robot
        self._stamped = stamped_by_default()
        kind = TwistStamped if self._stamped else Twist
        self.create_subscription(kind, "cmd_vel", self._on_command, RELIABLE)
        self._odometry = self.create_publisher(Odometry, "odom", SENSOR)
        self._scan = self.create_publisher(LaserScan, "scan", SENSOR)
        self._grids = []
        for topic, file in grids.items():
            self._grids.append(self.create_publisher(OccupancyGrid, topic, LATCHED))
            self._grids[-1].publish(_grid(nav2.read(file), self._stamp()))
        self._begun, self._ticks = time.monotonic(), 0
        self.create_timer(PERIOD, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _stamp(self) -> Any:
        return self.get_clock().now().to_msg()

    def _on_command(self, message: Any) -> None:
        self.robot.command(messages.twist_of(message.twist if self._stamped else message))

    def _tick(self) -> None:
        """Catch up with the wall's clock, and publish the measurements."""
        due = int((time.monotonic() - self._begun) / PERIOD)
        if due > self._ticks + BEHIND:
            self._begun += (due - self._ticks - BEHIND) * PERIOD
            due = self._ticks + BEHIND
        if due <= self._ticks:
            return
        self.robot.run(PERIOD * (due - self._ticks))
        if self.robot.fallen:
            self.get_logger().error("the robot has fallen", once=True)
        if self.robot.failed:
            self.get_logger().error(
                "its controller returned no action: the last is kept", once=True
            )
        before, self._ticks = self._ticks, due
        stamp = self._stamp()
        self._odometry.publish(_odometry(self.robot, stamp))
        if before // SCAN_EVERY < due // SCAN_EVERY:
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
        scan_time=PERIOD * SCAN_EVERY,
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
    """Simulate until it is interrupted; arguments as `SimulatedRobotNode` takes them."""
    running.run(lambda: SimulatedRobotNode(*args), sys.argv)
