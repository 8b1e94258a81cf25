"""What a sourced ROS may have and the wheels lack; the node does without where it is missing."""

import importlib
from typing import Any


def _found(module: str, *names: str) -> Any:
    """Return a module that has such names, or None where there is none."""
    try:
        imported = importlib.import_module(module)
    except ImportError:
        return None
    return imported if all(hasattr(imported, name) for name in names) else None


def state_message() -> Any:
    """Return Nav2's message of the collision monitor's state, or None."""
    return getattr(_found("nav2_msgs.msg"), "CollisionMonitorState", None)


def filter_info() -> Any:
    """Return Nav2's message that describes a mask, or None."""
    return getattr(_found("nav2_msgs.msg"), "CostmapFilterInfo", None)


def toggle() -> Any:
    """Return Nav2's service that switches the monitor, or None."""
    return getattr(_found("nav2_msgs.srv"), "Toggle", None)


class Transforms:
    """Looks transforms up in tf.

    Args:
        node: that listens.
    """

    def __init__(self, node: Any):
        tf2_ros = importlib.import_module("tf2_ros")
        self._newest = importlib.import_module("rclpy.time").Time()
        self._buffer = tf2_ros.Buffer()
        self._failed: Any = (tf2_ros.TransformException, LookupError)
        self._listener = tf2_ros.TransformListener(self._buffer, node)

    def close(self) -> None:
        """Listen no more."""
        self._listener.unregister()

    @staticmethod
    def can_be() -> bool:
        """Return whether tf2 can be imported."""
        return _found("tf2_ros", "Buffer", "TransformListener", "TransformException") is not None

    def newest(self, parent: str, child: str) -> Any:
        """Return the newest `geometry_msgs/TransformStamped` of a frame in another, or None."""
        try:
            return self._buffer.lookup_transform(parent, child, self._newest)
        except self._failed:
            return None


def bond(node: Any, name: str) -> Any:
    """Return a bond with the lifecycle manager that has begun, or None without bondpy."""
    module = _found("bondpy.bondpy", "Bond")
    if module is None:
        return None
    made = module.Bond(topic="/bond", id=name, node=node)
    made.set_heartbeat_period(0.25)
    made.set_heartbeat_timeout(4.0)
    made.start()
    return made
