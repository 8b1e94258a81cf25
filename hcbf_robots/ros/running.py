"""How a node of this package runs and ends, and the quality of service of its topics."""
# pyright: reportMissingImports=false
# rclpy comes with ROS, or with the extra ros-wheels

import signal
import threading
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from hcbf_gym.errors import InvalidInputError

RELIABLE = QoSProfile(depth=10)
SENSOR = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MASK = QoSProfile(depth=3, durability=DurabilityPolicy.TRANSIENT_LOCAL)

LOOKED_AT = 0.1
"""How long a signal waits at most [s]."""


def run(
    made: Callable[[], Any],
    arguments: list[str],
    begin: Callable[[Any], Any] = bool,
    end: Callable[[Any], Any] = bool,
) -> None:
    """Run a node until SIGINT or SIGTERM, or until ROS shuts down.

    Signals do not shut ROS down at once, as they would by default: the node publishes zero first. A
    second one ends the process.

    `begin` is called with the node before it spins, `end` in any case, while it can still publish.

    Raises:
        InvalidInputError: if ROS refuses the arguments.
    """
    ends = threading.Event()

    def stop(*_: Any) -> None:
        if ends.is_set():
            raise KeyboardInterrupt
        ends.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rclpy's parser has several kinds of exceptions
        raise InvalidInputError(
            f"ROS refuses the arguments or the parameter file: {error}"
        ) from error
    node = made()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        begin(node)
        while not ends.is_set() and rclpy.ok():
            executor.spin_once(timeout_sec=LOOKED_AT)
    finally:
        if rclpy.ok():
            end(node)
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
