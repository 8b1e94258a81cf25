"""Parameters: one table; what does not fit is refused by its name."""

import json
from pathlib import Path

import pytest

from benchmarks.ros import malformed
from hcbf_gym.errors import InvalidInputError
from hcbf_robots.ros import parameter
from hcbf_robots.ros.parameters import read
from hcbf_robots.ros.settings import Settings, SourceSettings

PAGE = Path(__file__).parents[2] / "docs" / "ros.md"
CART = {"max_forward": 0.5, "max_turn": 1.0, "look_ahead": 0.2}
MONITOR = {
    "base_frame_id": "base_footprint",
    "odom_frame_id": "odom",
    "cmd_vel_in_topic": "cmd_vel_smoothed",
    "cmd_vel_out_topic": "cmd_vel",
    "state_topic": "",
    "transform_tolerance": 0.1,
    "source_timeout": 2.0,
    "base_shift_correction": True,
    "stop_pub_timeout": 1.0,
    "enabled": True,
    "observation_sources": (),
}
"""Names and defaults of the collision monitor's code."""


def test_names_and_defaults_are_the_collision_monitors():
    settings = read(CART)
    assert {name: getattr(settings, name) for name in MONITOR} == MONITOR
    assert settings.cmd_vel_timeout == 0.25


@pytest.mark.parametrize(
    ("distribution", "stamped"),
    [("jazzy", False), ("kilted", True), ("lyrical", True), ("rolling", True)],
)
def test_velocities_are_stamped_as_the_distribution_has_them(monkeypatch, distribution, stamped):
    monkeypatch.setenv("ROS_DISTRO", distribution)
    assert read(CART).enable_stamped_cmd_vel is stamped


def test_sources_are_read_under_their_names():
    settings = read(
        {
            **CART,
            "observation_sources": ["front", "zone"],
            "front.topic": "scan",
            "front.margin": 1,
            "zone.type": "polygon",
            "zone.points": [0, 0, 1, 0, 1, 1],
            "zone.priority": 2,
            "use_sim_time": True,
            "qos_overrides./clock.subscription.depth": 1,
        }
    )
    front, zone = settings.sources
    assert (front.name, front.type, front.margin) == ("front", "scan", 1.0)
    assert (zone.points, zone.priority) == ((0.0, 0.0, 1.0, 0.0, 1.0, 1.0), 2)


REFUSED = {
    "cmd_vel_timeout": [-1.0, "soon", float("nan"), True, 0.0, 1e9],
    "enable_stamped_cmd_vel": [1, "true", None],
    "observation_sources": ["scan", [1], ["a", "a"], ["a.b"], ["period"], ["1st"]],
    "program": ["lex", 3],
    "pose_source": ["gps"],
    "period": [0.0, 1.0, "fast"],
    "max_forward": [0.0, -1.0, float("inf")],
    "odom_topic": ["", 5],
    "cmd_vel_out_topic": ["cmd_vel_smoothed"],
    "global_frame_id": ["map"],
    "robot": ["cart"],
    "max_sideways": [0.5],
    "s.type": ["pointcloud", "laser", 2],
    "s.priority": [0, 1.5, 99, "high"],
    "s.margin": [-0.1, float("nan")],
    "s.when_inside": ["flee"],
    "s.mount": [[0.0], "0 0 0", [0.0, 0.0, "x"]],
    "s.topic": [""],
    "s.file": ["map.yaml"],
    "s.points": [[0, 0, 1, 1, 2, 0]],
    "s.speling": [1],
    "cmd_vel_time_out": [0.2],
}
SCANNED = {**CART, "observation_sources": ["s"], "s.type": "scan", "s.topic": "scan"}


@pytest.mark.parametrize(
    ("name", "value"), [(name, value) for name, values in REFUSED.items() for value in values]
)
def test_what_does_not_fit_is_refused_by_its_name(name, value):
    with pytest.raises(InvalidInputError) as caught:
        read({**SCANNED, name: value})
    assert name in str(caught.value) or {"max_sideways"} == {name}, caught.value


def table_of(of):
    """Return the table of a page."""
    lines = ["| parameter | default | |", "|---|---|---|"]
    before = "<source>." if of is SourceSettings else ""
    for one in parameter.parameters_of(of):
        default = f"`{json.dumps(one.default)}`"
        if one.name == "enable_stamped_cmd_vel":
            default = "of the distribution"
        notes = [one.about]
        if one.choices:
            notes.append("one of " + ", ".join(f"`{json.dumps(choice)}`" for choice in one.choices))
        if one.live:
            notes.append("may be set at any time")
        lines.append(f"| `{before}{one.name}` | {default} | {'; '.join(notes)} |")
    return "\n".join(lines)


@pytest.mark.parametrize("of", [Settings, SourceSettings])
def test_the_page_has_the_table(of):
    assert table_of(of) in PAGE.read_text(encoding="utf-8")


def test_malformed_files_are_refused_by_name_and_others_are_valid(tmp_path):
    wrong = [one for one in malformed.run(40, tmp_path, first=1000) if not one.is_well]
    assert wrong == []
