"""Packages that a sourced ROS may have and the wheels lack; the node works without them."""

import importlib
from typing import Any


def _import(module: str, *names: str) -> Any:
    """Return a module by its name; None if it is missing, or lacks one of the names."""
    try:
        imported = importlib.import_module(module)
    except ImportError:
        return None
    return imported if all(hasattr(imported, name) for name in names) else None


def nav2(name: str, kind: str = "msg") -> Any:
    """Return the class of one of Nav2's messages, or services ("srv"); None without nav2_msgs."""
    return getattr(_import(f"nav2_msgs.{kind}"), name, None)


class Transforms:
    """Looks transforms up in tf.

    Args:
        node: that subscribes to them.
    """

    def __init__(self, node: Any):
        tf2_ros = importlib.import_module("tf2_ros")
        self._any_time = importlib.import_module("rclpy.time").Time()  # 0 means the newest
        self._buffer = tf2_ros.Buffer()
        self._lookup_errors: Any = (tf2_ros.TransformException, LookupError)
        self._listener = tf2_ros.TransformListener(self._buffer, node)

    def close(self) -> None:
        """End the subscriptions."""
        self._listener.unregister()

    @staticmethod
    def can_be_imported() -> bool:
        """Return whether tf2 is installed."""
        return _import("tf2_ros", "Buffer", "TransformListener", "TransformException") is not None

    def newest(self, parent: str, child: str) -> Any:
        """Return the newest `geometry_msgs/TransformStamped` of a frame in its parent, or None."""
        try:
            return self._buffer.lookup_transform(parent, child, self._any_time)
        except self._lookup_errors:
            return None


def bond(node: Any, name: str) -> Any:
    """Return a started bond of a node with the lifecycle manager; None without bondpy."""
    module = _import("bondpy.bondpy", "Bond")
    if module is None:
        return None
    started = module.Bond(topic="/bond", id=name, node=node)
    started.set_heartbeat_period(0.25)
    started.set_heartbeat_timeout(4.0)
    started.start()
    return started
