"""The node's transitions through real rclpy: what fails leaves nothing, and can be mended."""

import threading

import pytest
from needs import needs

GIVEN = {"max_forward": 0.26, "max_turn": 1.0, "look_ahead": 0.08, "reach": 0.22}
SCAN = {"observation_sources": ["scan"], "scan.topic": "scan"}
REFUSED = {
    "long source topic": ({"scan.topic": "s" * 300}, {"scan.topic": "scan"}),
    "namespace first": ({"scan.topic": "{ns}/x"}, {"scan.topic": "scan"}),
    "long odometry topic": ({"odom_topic": "o" * 300}, {"odom_topic": "odom"}),
    "two types on one topic": ({"scan.topic": "odom"}, {"scan.topic": "scan"}),
    "state on another's": ({"state_topic": "/diagnostics"}, {"state_topic": "state"}),
}


@pytest.fixture
def ros(monkeypatch):
    """A context of ROS for one test, on another domain."""
    import rclpy

    monkeypatch.setenv("ROS_DOMAIN_ID", "102")
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    rclpy.init()
    yield rclpy
    rclpy.shutdown()


@needs("rclpy")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of what ROS's wheels import
@pytest.mark.parametrize("name", REFUSED)
def test_a_topic_that_ros_refuses_leaves_nothing_and_can_be_mended(ros, name):
    from rclpy.parameter import Parameter

    from hcbf_robots.ros.node import DONE, FilterNode
    from hcbf_robots.ros.node import REFUSED as NOT_DONE
    from hcbf_robots.ros.worker import THREADS

    bad, good = REFUSED[name]

    def left(node):
        """What the node holds: publishers, subscriptions, timers, threads."""
        topics = node.count_publishers("/cmd_vel"), node.count_subscribers("/cmd_vel_smoothed")
        threads = sum(one.name.startswith(THREADS) for one in threading.enumerate())
        return *topics, len(list(node.timers)), threads

    node = FilterNode(
        parameter_overrides=[Parameter(k, value=v) for k, v in (GIVEN | SCAN | bad).items()]
    )
    try:
        assert node.trigger_configure() == NOT_DONE
        assert left(node) == (0, 0, 0, 0)
        (mended,) = node.set_parameters([Parameter(k, value=v) for k, v in good.items()])
        assert mended.successful, mended.reason
        assert node.trigger_configure() == DONE
        assert left(node) == (1, 1, 2, 0)  # threads begin with their first job
        node.trigger_cleanup()
        assert left(node) == (0, 0, 0, 0)
    finally:
        node.destroy_node()
