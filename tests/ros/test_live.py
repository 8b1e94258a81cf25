"""Through real rclpy, as on the page: robot, node and planner in three processes."""

import re
import shlex
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from needs import needs

from hcbf_robots import Walker
from hcbf_robots.maps import RankedMap

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "ros.md").read_text(encoding="utf-8")
ALONE = {
    "ROS_LOCALHOST_ONLY": "1",
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    "ROS_DOMAIN_ID": "101",
    "PYTHONPATH": str(ROOT),
}


@needs("rclpy")
@pytest.mark.physics
def test_the_pages_three_processes_lead_the_cart_round_wall_and_lawn(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, value in ALONE.items():
        monkeypatch.setenv(name, value)
    exec(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)[0], {})
    robot, node, planner = (
        shlex.split(re.search(rf"^{begin}.*$", PAGE, re.MULTILINE)[0])[1:]
        for begin in ("hcbf ros-sim", "hcbf ros ", "python examples")
    )
    hcbf = [sys.executable, "-m", "hcbf_gym.cli"]
    started = [
        subprocess.Popen([*hcbf, *words], stderr=subprocess.DEVNULL)
        for words in ([*robot, "--path", "path.npy"], node)
    ]
    try:
        script = [sys.executable, str(ROOT / planner[0]), *planner[1:]]
        done = subprocess.run(script, capture_output=True, text=True, timeout=150, check=False)
        assert done.stdout.endswith("arrived\n"), done.stdout + done.stderr
    finally:
        for one in started:
            one.terminate()
        codes = [one.wait(20) for one in started]
    assert codes == [0, 0]
    places = np.load("path.npy")[:, 1:3]
    rooms = [RankedMap.load(f"{name}.yaml", unknown=None) for name in ("room", "lawn")]
    reach = Walker.load("cart").reach
    least = min(room.distance(places, 1).min() for room in rooms)
    assert least >= reach


@pytest.mark.skipif("rclpy" in sys.modules, reason="rclpy is imported")
def test_without_rclpy_both_ways_to_it_are_named():
    code = (
        "import sys, importlib.util as u; find = u.find_spec\n"
        "u.find_spec = lambda name, *a: None if name == 'rclpy' else find(name, *a)\n"
        "from hcbf_gym import cli; cli.main(['ros'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 1
    assert "setup.bash" in done.stderr
    assert "ros-wheels" in done.stderr


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
