"""The simulated robot's node; it needs rclpy."""

import math
import sys
import time
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import LaserScan

from hcbf_gym.maps import nav2
from hcbf_gym.ros import messages
from hcbf_gym.ros.node import LATCHED, RELIABLE, SENSOR, executor_of
from hcbf_gym.ros.parameters import stamped_by_default
from hcbf_gym.ros.robot import BEAMS, FARTHEST_BEAM, NEAREST_BEAM, SimulatedRobot
from hcbf_gym.ros.simulated import Args

PERIOD = 0.02
"""Of the odometry [s]."""
SCAN_EVERY = 5
"""Odometry messages between two scans."""


class SimulatedRobotNode(Node):
    """Steps the robot as time goes on, and publishes what it measures.

    Args:
        args: of the command.
    """

    def __init__(self, args: Args):
        super().__init__("hcbf_robot")
        self.robot = SimulatedRobot(args.robot, args.map, args.start, args.noise, seed=args.seed)
        self._rate, self._drives_clock = args.clock or 1.0, args.clock > 0.0
        stamped = stamped_by_default() if args.stamped is None else args.stamped
        kind = TwistStamped if stamped else Twist
        self.create_subscription(kind, "cmd_vel", self._on_command, RELIABLE)
        self._odometry = self.create_publisher(Odometry, "odom", SENSOR)
        self._scan = self.create_publisher(LaserScan, "scan", SENSOR)
        self._clock_out = self.create_publisher(ClockMessage, "/clock", SENSOR)
        self._grids = []
        for file, topic in [(args.map, "map"), *((one, _topic(one)) for one in args.masks)]:
            if file:
                self._grids.append(self.create_publisher(OccupancyGrid, topic, LATCHED))
                self._grids[-1].publish(_grid(nav2.read(file), self._stamp()))
        self._begun, self._ticks = time.monotonic(), 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(PERIOD / self._rate, self._tick, clock=steady)

    def timed_path(self) -> Any:
        """Return (N, 4) time [s], x, y [m] and yaw [rad] of every tick."""
        path = np.array(self.robot.path).reshape(-1, 3)
        return np.column_stack([self.robot.dt * np.arange(1, len(path) + 1), path])

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
        due = min(int((time.monotonic() - self._begun) * self._rate / PERIOD), self._ticks + 5)
        if due <= self._ticks:
            return
        self.robot.run(PERIOD * (due - self._ticks))
        before, self._ticks = self._ticks, due
        stamp = self._stamp()
        if self._drives_clock:
            self._clock_out.publish(ClockMessage(clock=stamp))
        self._odometry.publish(_odometry(self.robot, stamp))
        if before // SCAN_EVERY < due // SCAN_EVERY:
            self._scan.publish(_scan(self.robot, stamp))


def _topic(mask: str) -> str:
    """Return the topic of a mask: the name of its file without the ending."""
    return mask.rsplit("/", 1)[-1].rsplit(".", 1)[0]


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


def spin(args: Args) -> None:
    """Simulate until it is interrupted, and write the path if it is asked for."""
    rclpy.init(args=sys.argv)
    node = SimulatedRobotNode(args)
    executor = executor_of()
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        if args.path is not None:
            np.save(args.path, node.timed_path())
        node.destroy_node()
        rclpy.try_shutdown()
