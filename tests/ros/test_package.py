"""The package of ROS as files: what it names is there, and its parameters are the node's."""

import ast
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from hcbf_gym import version
from hcbf_gym.cli import commands
from hcbf_robots.ros import filters
from hcbf_robots.ros.parameters import read

yaml = pytest.importorskip("yaml")
PACKAGE = Path(__file__).parents[2] / "ros" / "hcbf_ros"
NODES = Path(filters.__file__).parent


def flat(given, before=""):
    """Return parameters with dots between the names of a file's levels."""
    found = {}
    for name, value in given.items():
        found |= (
            flat(value, f"{before}{name}.") if isinstance(value, dict) else {before + name: value}
        )
    return found


def test_the_shipped_parameters_make_a_robot():
    (given,) = yaml.safe_load((PACKAGE / "config/hcbf_filter.yaml").read_text("utf-8")).values()
    settings = read(flat(given["ros__parameters"]))
    robot = filters.robot_of(settings)
    assert 0.25 < robot.reach < 0.26
    assert [one.name for one in settings.sources] == ["scan"]


def test_what_the_page_makes_of_nav2s_parameters_is_taken():
    page = (PACKAGE.parents[1] / "docs" / "ros.md").read_text("utf-8")
    (diff,) = re.findall(r"^```diff\n(.*?)^```$", page, flags=re.DOTALL | re.MULTILINE)
    kept = "\n".join(line[1:] for line in diff.splitlines() if not line.startswith("-"))
    (given,) = yaml.safe_load(kept).values()
    settings = read(flat(given["ros__parameters"]))
    assert (settings.pose_source, settings.global_frame_id) == ("tf", "map")
    assert [one.type for one in settings.sources] == ["scan", "map", "keepout"]
    assert filters.robot_of(settings).command.forward == 0.26


def test_the_manifest_has_one_version_and_all_that_is_imported():
    manifest = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert manifest.get("format") == "3"
    released = version.release().partition(".dev")[0]  # ROS accepts three numbers alone
    assert manifest.findtext("version") == released
    assert f'version="{released}"' in (PACKAGE / "setup.py").read_text("utf-8")
    depends = {one.text for one in manifest.findall("exec_depend")}
    imported = set()
    for file in (*NODES.glob("*.py"), *PACKAGE.rglob("*.py")):
        if file.name in ("sim_node.py", "setup.py"):
            continue
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                imported.add(node.module.split(".")[0])
    ros = {name for name in imported if name.endswith(("_msgs", "_srvs", "_interfaces", "_ros"))}
    assert ros | {"rclpy", "launch"} == depends - {"python3-numpy"}


def test_what_setup_names_is_there():
    text = (PACKAGE / "setup.py").read_text("utf-8")
    assert "hcbf_filter = {NAME}.filter:main" in text
    assert "def main(" in (PACKAGE / "hcbf_ros/filter.py").read_text("utf-8")
    assert (PACKAGE / "resource/hcbf_ros").exists()
    assert 'executable="hcbf_filter"' in (PACKAGE / "launch/filter.launch.py").read_text("utf-8")
    assert "ros" in commands()
