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
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import LaserScan

from hcbf_robots.maps import nav2
from hcbf_robots.ros import messages, running
from hcbf_robots.ros.parameters import stamped_by_default
from hcbf_robots.ros.robot import BEAMS, FARTHEST_BEAM, NEAREST_BEAM, SimulatedRobot
from hcbf_robots.ros.running import LATCHED, RELIABLE, SENSOR

PERIOD = 0.02
"""Of the odometry [s]."""
SCAN_EVERY = 5
"""Odometry messages between two scans."""
BEHIND = 5
"""Periods that it catches up at once at most: a machine that is too slow makes time go slowly."""


class SimulatedRobotNode(Node):
    """Steps the robot as time goes on, and publishes what it measures.

    Args:
        robot: what is stepped.
        grids: topic → file of each map and mask that it publishes.
        stamped: whether cmd_vel is TwistStamped; None is as the distribution has it.
        clock: how many times as fast as the wall's clock its own goes, on /clock; 0 for none.
    """

    def __init__(
        self, robot: SimulatedRobot, grids: dict[str, str], stamped: bool | None, clock: float
    ):
        super().__init__("hcbf_robot")
        self.robot = robot
        self._rate, self._drives_clock = clock or 1.0, clock > 0.0
        is_stamped = stamped_by_default() if stamped is None else stamped
        kind = TwistStamped if is_stamped else Twist
        self.create_subscription(kind, "cmd_vel", self._on_command, RELIABLE)
        self._odometry = self.create_publisher(Odometry, "odom", SENSOR)
        self._scan = self.create_publisher(LaserScan, "scan", SENSOR)
        if self._drives_clock:
            self._clock_out = self.create_publisher(ClockMessage, "/clock", SENSOR)
        self._grids = []
        for topic, file in grids.items():
            self._grids.append(self.create_publisher(OccupancyGrid, topic, LATCHED))
            self._grids[-1].publish(_grid(nav2.read(file), self._stamp()))
        self._begun, self._ticks = time.monotonic(), 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(PERIOD / self._rate, self._tick, clock=steady)

    def _stamp(self) -> Any:
        if not self._drives_clock:
            return self.get_clock().now().to_msg()
        whole = math.floor(self.robot.time)
        made = ClockMessage()
        made.clock.sec, made.clock.nanosec = whole, int(1e9 * (self.robot.time - whole))
        return made.clock

    def _on_command(self, message: Any) -> None:
        twist = message.twist if isinstance(message, TwistStamped) else message
        self.robot.tell(messages.twist_of(twist))

    def _tick(self) -> None:
        """Catch up with the wall's clock, and say what is measured."""
        due = int((time.monotonic() - self._begun) * self._rate / PERIOD)
        if due > self._ticks + BEHIND:
            self._begun += (due - self._ticks - BEHIND) * PERIOD / self._rate
            due = self._ticks + BEHIND
        if due <= self._ticks:
            return
        self.robot.run(PERIOD * (due - self._ticks))
        if self.robot.fallen:
            self.get_logger().error("the robot has fallen, and lies there", once=True)
        if self.robot.failed:
            self.get_logger().error("its controller gave no action; the last is kept", once=True)
        before, self._ticks = self._ticks, due
        stamp = self._stamp()
        if self._drives_clock:
            self._clock_out.publish(ClockMessage(clock=stamp))
        self._odometry.publish(_odometry(self.robot, stamp))
        if before // SCAN_EVERY < due // SCAN_EVERY:
            self._scan.publish(_scan(self.robot, stamp))


def _odometry(robot: SimulatedRobot, stamp: Any) -> Odometry:
    message = Odometry(child_frame_id="base_footprint")
    message.header.stamp, message.header.frame_id = stamp, "odom"
    (x, y, yaw), (vx, vy, w) = robot.pose.tolist(), robot.twist.tolist()
    place, motion = message.pose.pose, message.twist.twist
    place.position.x, place.position.y = x, y
    place.orientation.z, place.orientation.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    motion.linear.x, motion.linear.y, motion.angular.z = vx, vy, w
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
    x, y, yaw = grid.origin
    info.origin.position.x, info.origin.position.y = x, y
    info.origin.orientation.z, info.origin.orientation.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    message.data = raster.occupancy.astype(np.int8).ravel().tolist()
    return message


def spin(robot: SimulatedRobot, grids: dict[str, str], stamped: bool | None, clock: float) -> None:
    """Simulate until it is interrupted; see `SimulatedRobotNode`."""
    running.run(
        lambda: SimulatedRobotNode(robot, grids, stamped, clock),
        sys.argv,
        lambda node: None,
        lambda node: None,
    )
