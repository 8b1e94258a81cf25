"""Runs a node of this package until a signal ends it; the quality of service of its topics."""
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

SPIN_TIMEOUT = 0.1
"""Longest time after which a node sees a signal [s]."""


def run(
    make_node: Callable[[], Any],
    arguments: list[str],
    begin: Callable[[Any], Any] = bool,
    end: Callable[[Any], Any] = bool,
) -> None:
    """Run a node until SIGINT or SIGTERM, or until ROS shuts down.

    A signal does not shut ROS down at once, as it would by default, so that the node can publish
    zero first. A second signal ends the process. `begin` is called with the node before it spins,
    and `end` in any case, while it can still publish.

    Raises:
        InvalidInputError: if ROS refuses the arguments.
    """
    has_signal = threading.Event()

    def stop(*_: Any) -> None:
        if has_signal.is_set():
            raise KeyboardInterrupt
        has_signal.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rclpy's parser has several kinds of exceptions
        raise InvalidInputError(
            f"ROS refuses the arguments or the parameter file: {error}"
        ) from error
    node = make_node()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        begin(node)
        while not has_signal.is_set() and rclpy.ok():
            executor.spin_once(timeout_sec=SPIN_TIMEOUT)
    finally:
        if rclpy.ok():
            end(node)
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
