"""What changes while the node runs: maps, odometry's frame, sensors, zones, goals."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.ros.drive import Drive
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.guidance import Geodesic
from hcbf_robots import VelocityFilter
from hcbf_robots.maps.nav2 import Raster
from hcbf_robots.ros import messages, parameters
from hcbf_robots.ros.decisions import Level
from hcbf_robots.ros.sources import grid_of
from hcbf_robots.ros.watches import Now
from tests.ros.test_node_core import ZONE, show

pytestmark = pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")

MAP = {"observation_sources": ["map"], "map.type": "map", "map.topic": "map"}
LED = {"guidance": "geodesic", **MAP}


def hear_map(d, cells=100, origin=-5.0, resolution=0.1, stamp=None, block=None):
    """Let a map come; `block` is a window of it that is occupied."""
    values = np.zeros((cells, cells), dtype=np.int16)
    if block is not None:
        values[block] = 100
    raster = Raster(grid_of(resolution, (origin, origin, 0.0), cells, cells), values)
    shown = d.core.of_grid("map", raster)
    when = d.now.ros if stamp is None else stamp
    return d.core.hear_source("map", shown, when, d.now, "odom")


OTHERS = {
    "grown": {"cells": 120},
    "moved": {"origin": -4.5},
    "finer": {"cells": 200, "resolution": 0.05},
    "other cells": {"block": np.s_[80:83, 50:53]},
}


@pytest.mark.parametrize("how", OTHERS)
def test_a_map_that_changes_costs_no_step_and_no_field_in_one(how, monkeypatch):
    d = Drive(LED, wanted=(0.0, 0.0, 0.0))
    hear_map(d)
    d.run(0.5)
    d.core.take(d.core.planned((3.0, 0.0)))
    d.run(0.5)
    computed = []
    solve = Geodesic._solve
    monkeypatch.setattr(Geodesic, "_solve", lambda *parts: computed.append(1) or solve(*parts))
    d.run(0.1)
    assert hear_map(d, **OTHERS[how])
    d.run(2.0)
    assert not computed
    assert d.velocity[0] > 0.1  # it leads as before
    d.core.take(d.core.planned((3.0, 0.0)))
    d.run(0.5)
    assert d.velocity[0] > 0.1


FRAMES = [{}, {"pose_source": "tf", "global_frame_id": "map"},
          {"pose_source": "topic", "global_frame_id": "map"}]  # fmt: skip


@pytest.mark.parametrize("given", FRAMES, ids=["odom", "tf", "topic"])
@pytest.mark.parametrize("silent", [0.0, 1.5])
def test_odometry_that_begins_anew_is_a_jump_however_long_it_was_silent(given, silent):
    d = Drive(given, wanted=(0.4, 0.0, 0.0))
    place(d, given, d.now.ros)
    d.run(2.0)
    old = d.now.ros
    d.pose = np.zeros(3)
    d.run(silent, odometry=False)
    tf = (lambda d: place(d, given, old)) if "tf" in given.values() else None
    d.run(0.1, each=tf)
    assert "jumped" in d.last.message
    assert (d.last.command is None) or not d.last.command.any()
    d.run(2.0, each=tf)
    if given:  # the place of the new frame is unknown since
        assert "odometry has jumped" in d.last.message
        assert d.velocity[0] == 0.0
        place(d, given, d.now.ros)
    d.run(2.0)
    assert d.velocity[0] > 0.1


def place(d, given, stamp):
    """Place odometry's frame, as tf or a pose topic does."""
    source = given.get("pose_source")
    if source == "tf":
        d.core.localization.hear_correction((0.0, 0.0, 0.0), stamp)
    elif source == "topic":
        d.run(0.1)
        d.core.localization.hear_pose(d.pose, d.now.ros - 0.02, d.now, "map")


@pytest.mark.parametrize("seconds", [0.5, 1.0, 2.0, 5.0])
def test_odometry_that_was_silent_while_the_robot_stopped_has_not_jumped(seconds):
    given = FRAMES[2]
    d = Drive(given, wanted=(0.4, 0.0, 0.3))
    place(d, given, d.now.ros)
    d.run(2.0)
    d.run(seconds, odometry=False)
    assert not d.velocity.any()
    d.run(0.5)
    assert "jumped" not in d.last.message
    assert d.velocity[0] > 0.1


@pytest.mark.parametrize("ahead", [0.3, 100.0, -1e6])
def test_a_map_counts_that_came_last_whatever_its_stamp(ahead):
    d = Drive(MAP, wanted=(0.4, 0.0, 0.0)).run(0.2)
    hear_map(d, stamp=d.now.ros + ahead)
    d.run(1.0)
    assert d.velocity[0] > 0.1
    assert hear_map(d, stamp=d.now.ros - 1.0, block=np.s_[40:60, 60:62])  # the newest
    d.run(8.0)
    assert d.pose[0] < 1.0


def test_a_zone_that_is_repeated_is_unchanged_and_one_that_is_switched_is_planned_again():
    d = Drive({**ZONE, "guidance": "geodesic", "zone.points": [1.5, -2, 2, -2, 2, 0.1, 1.5, 0.1]},
              wanted=(0.0, 0.0, 0.0))  # fmt: skip
    d.run(0.3)
    corners = [(1.5, -2.0), (2.0, -2.0), (2.0, 0.1), (1.5, 0.1)]
    before = d.core.sources["zone"].entries
    show(d, "zone", corners)
    assert d.core.sources["zone"].entries == before
    show(d, "zone", [])  # of the same stamp
    assert not d.core.sources["zone"].entries
    show(d, "zone", corners)
    d.core.change({"zone.enabled": False})
    d.core.take(d.core.planned((4.0, 0.0)))
    d.run(0.2)
    assert d.core.goal_to_plan() is None
    d.core.change({"zone.enabled": True})
    d.run(14.0)  # which plans, as the node does
    assert np.hypot(d.pose[0] - 4.0, d.pose[1]) < 0.6


def test_a_goal_of_before_it_was_activated_leads_nowhere():
    d = Drive(LED, wanted=(0.0, 0.0, 0.0))
    hear_map(d)
    d.run(0.3)
    d.core.take(d.core.planned((3.0, 0.0)))
    d.run(0.5)
    assert d.velocity[0] > 0.1
    d.core.activate()
    d.run(2.0)
    before = d.pose
    d.run(2.0)
    assert (d.pose == before).all()
    assert d.core.goal is None


@pytest.mark.parametrize("kind", ["polygon", "circle", "map", "keepout"])
def test_maps_and_zones_of_another_frame_are_refused(kind):
    given = {"max_forward": 0.5, "max_turn": 1.0, "look_ahead": 0.2, "observation_sources": ["z"],
             "z.type": kind, "z.topic": "z", "z.frame_id": "base_footprint"}  # fmt: skip
    with pytest.raises(
        InvalidInputError, match=r"z\.frame_id: got 'base_footprint', expected global_frame_id"
    ):
        parameters.read(given)
    parameters.read(given | {"z.frame_id": "odom"})


def turned(x=0.0, y=0.0, z=0.0, w=1.0):
    """Return a transform with a rotation."""
    moved = SimpleNamespace(x=0.2, y=0.0, z=0.1)
    return SimpleNamespace(translation=moved, rotation=SimpleNamespace(x=x, y=y, z=z, w=w))


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
@pytest.mark.parametrize("hangs", [False, True])
def test_a_scanner_that_hangs_upside_down_sees_what_is_there(yaw, hangs):
    cos, sin = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    rotation = turned(x=cos, y=sin, w=0.0) if hangs else turned(z=sin, w=cos)
    mount, upside_down = messages.mount_of(rotation)
    assert upside_down == hangs
    np.testing.assert_allclose(mount, (0.2, 0.0, yaw), atol=1e-12)


@pytest.mark.parametrize("norm", [0.96, 1.0, 1.04])
@pytest.mark.parametrize("tilt", [0.2, 1.0, 2.0, -0.5])
def test_a_tilted_scanner_is_refused(tilt, norm):
    with pytest.raises(InvalidInputError, match="tilt of"):
        messages.mount_of(turned(y=norm * math.sin(0.5 * tilt), w=norm * math.cos(0.5 * tilt)))
    messages.mount_of(turned(y=norm * math.sin(0.0475), w=norm * math.cos(0.0475)))


def test_a_quaternion_is_normalised_within_five_percent_and_else_a_fault_wherever_it_is_read():
    by_pose, by_tf = Drive({"pose_source": "topic"}), Drive({"pose_source": "tf"})
    by_odometry = Drive()
    for norm in (0.0, 0.5, 0.94, 0.951, 1.0, 1.049, 1.06, 2.0, math.nan, math.inf):
        sound = abs(norm - 1.0) <= 0.05
        for yaw in (0.0, 0.7, -2.0):
            rotation = turned(z=norm * math.sin(0.5 * yaw), w=norm * math.cos(0.5 * yaw))
            place = SimpleNamespace(
                position=SimpleNamespace(x=1.0, y=2.0), orientation=rotation.rotation
            )
            pose, moved = messages.pose_of(place), messages.transform_of(rotation)
            info = SimpleNamespace(origin=place, resolution=0.1, width=1, height=1)
            grid = SimpleNamespace(info=info, data=[0])
            for d in (by_pose, by_tf, by_odometry):
                d.now = Now(d.now.ros + 0.02, d.now.steady + 0.02)
                d.say_odometry(pose if d is by_odometry else None)
            by_pose.core.localization.hear_pose(pose, by_pose.now.ros, by_pose.now, "odom")
            by_tf.core.localization.hear_correction(moved, by_tf.now.ros)
            found = [
                "; ".join(str(one) for one in d.core.localization.faults(d.now) if one)
                for d in (by_pose, by_tf, by_odometry)
            ]
            if sound:
                assert (pose[2], moved[2]) == pytest.approx((yaw, yaw))
                assert messages.mount_of(rotation)[0][2] == pytest.approx(yaw)
                assert messages.raster_of(grid).grid.origin[2] == pytest.approx(yaw)
                assert not any("quaternion" in one for one in found)
                continue
            assert all("and a quaternion of the norm 1" in one for one in found), found
            for read, one in ((messages.mount_of, rotation), (messages.raster_of, grid)):
                with pytest.raises(InvalidInputError, match="expected a quaternion of the norm 1"):
                    read(one)


def scan(count=360, step=math.tau / 360, last=None):
    """Return what a laser scan has."""
    end = -math.pi + (count - 1) * step if last is None else last
    return SimpleNamespace(
        ranges=[2.0] * count, angle_min=-math.pi, angle_max=end, angle_increment=step,
        time_increment=0.0, range_min=0.1, range_max=9.0,
    )  # fmt: skip


@pytest.mark.parametrize("count", [1, 150, 357, 364])
def test_a_scan_that_was_cut_is_refused(count):
    whole = scan()
    for lacks in (-1, 0, 1):  # drivers disagree whether angle_max is the last beam's
        messages.beams_of(scan(360 + lacks, last=whole.angle_max))
    with pytest.raises(InvalidInputError, match=f"got {count} ranges, expected 360"):
        messages.beams_of(scan(count, last=whole.angle_max))
    backwards = scan(step=-math.tau / 360)
    assert messages.beams_of(backwards).step < 0.0


@pytest.mark.parametrize("stands", [False, True])
def test_a_filter_that_raises_stops_the_robot_and_is_named_and_the_node_continues(
    stands, monkeypatch
):
    d = Drive(wanted=(0.4, 0.0, 0.0)).run(1.0)
    with monkeypatch.context() as broken:
        error = InvalidInputError("guidance: got something else")

        def raises(*_, **__):
            raise error

        broken.setattr(VelocityFilter, "step", raises)
        d.run(0.5, odometry=not stands)
        assert (d.last.command == 0.0).all()
        assert "filter: guidance: got something else" in d.last.message
        assert d.last.level == Level.ERROR
    d.run(1.0)
    assert d.velocity[0] > 0.1


def test_a_transform_of_before_a_jump_is_not_accepted_though_tf_had_none_for_a_moment():
    """A localization dates its transforms ahead, so that they hold until the next."""
    d = Drive(FRAMES[1], wanted=(0.4, 0.0, 0.0))
    ahead = d.now.ros + 10.0
    place(d, FRAMES[1], ahead)
    d.run(1.0)
    d.core.localization.hear_correction(None, 0.0)
    d.pose = d.pose + np.array([2.0, 0.0, 0.0])
    d.run(0.05)  # the jump is heard meanwhile
    d.run(1.0, each=lambda d: place(d, FRAMES[1], ahead))
    assert "odometry has jumped" in d.last.message
    assert d.velocity[0] == 0.0
