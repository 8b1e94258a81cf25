"""A planner that knows no obstacle: `python examples/ros_planner.py X Y`, beside `hcbf ros`.

It turns to its goal, drives at it, publishes it to guidance, and ends where it has arrived.
"""

import math
import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

GOAL = float(sys.argv[1]), float(sys.argv[2])
NEAR, LONGEST = 0.3, 240.0  # [m], [s]


class Planner(Node):
    def __init__(self):
        super().__init__("planner")
        self.velocity = self.create_publisher(TwistStamped, "cmd_vel_smoothed", 10)
        self.goal = self.create_publisher(PoseStamped, "goal_pose", 10)
        self.create_subscription(Odometry, "odom", self.heard, qos_profile_sensor_data)
        self.pose, self.published = None, -1.0
        self.create_timer(0.05, self.drive)

    def heard(self, message):
        at, turned = message.pose.pose.position, message.pose.pose.orientation
        self.pose = at.x, at.y, 2.0 * math.atan2(turned.z, turned.w)

    @property
    def left(self):
        return math.inf if self.pose is None else math.dist(self.pose[:2], GOAL)

    def drive(self):
        if self.pose is None:
            return
        if time.monotonic() - self.published > 1.0:  # repeatedly, for late subscribers
            self.published = time.monotonic()
            goal = PoseStamped()
            goal.header.frame_id = "odom"
            goal.pose.position.x, goal.pose.position.y = GOAL
            self.goal.publish(goal)
        x, y, yaw = self.pose
        turn = math.remainder(math.atan2(GOAL[1] - y, GOAL[0] - x) - yaw, math.tau)
        message = TwistStamped()
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = "base_footprint"
        message.twist.linear.x = 0.8 * max(0.0, math.cos(turn)) * min(1.0, self.left)
        message.twist.angular.z = max(-1.0, min(1.0, 2.0 * turn))
        self.velocity.publish(message)


rclpy.init()
planner, begun, shown = Planner(), time.monotonic(), 0.0
while planner.left > NEAR and time.monotonic() - begun < LONGEST:
    rclpy.spin_once(planner, timeout_sec=0.1)
    if time.monotonic() - shown > 1.0 and planner.pose is not None:
        shown = time.monotonic()
        print("x {:.2f} m, y {:.2f} m".format(*planner.pose[:2]), flush=True)
arrived = planner.left <= NEAR
print("arrived" if arrived else f"not arrived: {planner.left:.2f} m are left")
planner.destroy_node()
rclpy.shutdown()
sys.exit(not arrived)
