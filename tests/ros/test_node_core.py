"""The node's core: zero in time and why, silence, sources, poses, guidance."""

import math

import numpy as np
import pytest

from benchmarks.ros import faults
from benchmarks.ros.drive import ANGLES, HARDEST, SCAN, Drive
from hcbf_gym import _core
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.guidance import Geodesic
from hcbf_robots.maps.nav2 import Raster
from hcbf_robots.maps.scan import FINE
from hcbf_robots.ros import sources
from hcbf_robots.ros.decisions import Action, Level
from hcbf_robots.ros.filters import HELD
from hcbf_robots.ros.sources import Beams, grid_of

pytestmark = pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")

ZONE = {"observation_sources": ["zone"], "zone.type": "polygon", "zone.topic": "zone"}
AROUND = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]


def show(d, name, corners):
    """Let a zone come, move or go."""
    d.core.hear_source(
        name,
        sources.of_polygon(d.core.sources[name].settings, corners),
        d.now.ros,
        d.now,
        "odom",
    )


@pytest.mark.parametrize("name", faults.CASES)
@pytest.mark.parametrize("seed", [1000, 1001, 1002])
def test_faults_bring_zero_in_time_with_their_reason_and_motion_after_them(name, seed):
    trial = faults.try_case(name, seed)
    assert trial.in_time, trial.messages
    assert trial.stands, trial.away
    assert trial.named, trial.messages
    assert trial.again, trial.messages


def test_a_velocity_of_before_it_was_activated_moves_nothing():
    d = Drive().run(1.0)
    assert d.last.command[0] > 0.1
    d.core.activate()
    d.run(0.15, command=False)
    assert "command: nothing received" in d.last.message
    assert (d.last.command == 0.0).all()
    d.run(1.0)
    assert d.last.command[0] > 0.1


def test_before_the_first_command_nothing_is_published_and_without_odometry_zero():
    d = Drive().run(0.5, command=False)
    assert d.decisions
    assert all(one.command is None for _, one in d.decisions)
    d = Drive().run(0.5, odometry=False)
    assert (d.last.command == 0.0).all()
    assert "odometry: nothing received" in d.last.message
    assert d.last.level == Level.ERROR


@pytest.mark.parametrize("silent", [True, False])
def test_after_zero_for_long_enough_it_is_silent_and_publishes_again(silent):
    """Zero because the planner is silent, or because it commands zero."""
    d = Drive().run(1.0)
    begun, d.wanted = d.now.steady, (0.0, 0.0, 0.0)
    d.run(3.0, command=not silent)
    times = [now.steady for now, one in d.decisions if now.steady > begun and one.command is None]
    assert begun + 1.0 - 0.06 <= times[0] <= begun + 1.6  # time-out or braking, stop_pub_timeout
    assert len(times) > 20  # it remains so
    assert d.last.level == (Level.STALE if silent else Level.OK)
    d.wanted = (0.4, 0.0, 0.0)
    d.run(0.2)
    assert d.last.command[0] > 0.1


def test_a_source_may_have_another_time_out_or_none():
    d = Drive({**SCAN, "scan.source_timeout": 0.3}).run(1.0).run(0.25, scan=False)
    assert d.velocity[0] > 0.1
    d.run(0.15, scan=False)
    assert (d.last.action, d.last.name) == (Action.STOP, "invalid source")
    assert not d.velocity.any()
    assert Drive({**SCAN, "scan.source_timeout": 0.0}).run(1.0).run(5.0, scan=False).velocity[0] > 0


def test_not_enabled_passes_commands_on_while_they_are_fresh():
    d = Drive({"enabled": False, **ZONE}).run(0.3, odometry=False)
    assert d.last.command.tolist() == [0.4, 0.0]
    assert d.last.level == Level.WARN
    d.run(0.5, command=False)
    assert (d.last.command == 0.0).all()
    d.core.enabled = True
    d.run(0.3, odometry=False)
    assert "odometry" in d.last.message


def test_a_source_that_is_not_enabled_does_not_count():
    d = Drive({**SCAN, "scan.enabled": False}).run(0.5, scan=False)
    assert d.last.command[0] > 0.1
    d.core.change({"scan.enabled": True})
    d.run(0.1, scan=False)
    assert (d.last.command == 0.0).all()
    assert d.last.name == "invalid source"  # as in the collision monitor


def test_a_wall_of_the_scan_stops_it_before_the_wall():
    d = Drive(SCAN, wanted=(0.6, 0.0, 0.0))
    ahead = np.abs(np.arange(72) - 36) < 9

    def look(d):
        wall = (3.0 - d.pose[0]) / np.cos((np.arange(72) - 36) * np.deg2rad(5.0))
        d.ranges = np.where(ahead, wall, np.inf)

    d.run(15.0, each=look)
    assert 2.0 < d.pose[0] < 3.0 - 0.3
    assert {one.name for _, one in d.decisions if one.action == Action.LIMIT} == {"scan"}


def test_a_zone_around_the_robot_is_left_or_stops_it():
    leaves = Drive({**ZONE, "zone.priority": 2}, start=(0.3, 0.0, 0.0)).run(0.5)
    leaves.wanted = (0.0, 0.0, 0.0)
    show(leaves, "zone", AROUND + leaves.pose[:2])
    centre = leaves.pose[:2]
    leaves.run(8.0)
    assert np.abs(leaves.pose[:2] - centre).max() > 0.5 + 0.29

    stops = Drive({**ZONE, "zone.when_inside": "stop"}).run(0.5)
    show(stops, "zone", AROUND + stops.pose[:2])
    stops.run(0.1)
    assert stops.last.message == "zone: the robot is inside"
    before, speed = stops.pose, stops.motion[0]
    stops.run(speed / HARDEST[0] + 0.05)
    stood = stops.pose
    stops.run(2.0)
    assert (stops.pose == stood).all()
    assert np.hypot(*(stood - before)[:2]) <= speed**2 / HARDEST[0]
    show(stops, "zone", [])
    stops.run(0.5)
    assert stops.last.command[0] > 0.1


def test_a_source_reserves_its_margin():
    apart = []
    for margin in (0.0, 0.3):
        d = Drive({**ZONE, "zone.margin": margin}, wanted=(0.5, 0.0, 0.0)).run(0.2)
        show(d, "zone", [(3.0, -2.0), (4.0, -2.0), (4.0, 2.0), (3.0, 2.0)])
        d.run(20.0)
        apart.append(3.0 - d.pose[0])
    assert apart[0] > 0.3
    assert apart[1] - apart[0] == pytest.approx(0.3, abs=0.02)


def test_a_scan_that_was_being_prepared_when_odometry_began_anew_has_no_place():
    """It waits for the other thread while odometry's frame changes."""
    d = Drive(SCAN).run(1.0)
    prepared, stamp = d.core.of_scan("scan", beams(d)), d.now.ros - 0.2
    d.pose = d.pose + np.array([2.0, 0.0, 0.0])
    d.run(0.02, scan=False)
    assert not d.core.hear_source("scan", prepared, stamp, d.now, "base_footprint")
    assert d.core.sources["scan"].watch.fault(d.now) is not None


def beams(d):
    return Beams(d.ranges, 0.0, 0.1, 0.0, 10.0)


def test_a_scan_is_placed_by_the_pose_at_its_stamp():
    d = (
        Drive({**SCAN, "scan.mount": [0.1, 0.0, np.pi / 2]}, wanted=(0.8, 0.0, 0.0))
        .run(1.0)
        .run(0.2, scan=False)
    )
    d.ranges = np.array([1.0, np.nan, 0.01, 99.0])
    stamp = d.now.ros - 0.1
    shown = d.core.of_scan("scan", beams(d))
    assert d.core.hear_source("scan", shown, stamp, d.now, "base_footprint")
    (scan,) = d.core.sources["scan"].entries
    corner = np.array([d.pose[0] - 0.08 + 0.1, 1.0])  # one beam, ahead of a sensor that looks left
    assert abs(scan.conditions[0].nearest(np.array([*corner, 0.0, 0.0]))[0]) < 0.1


def test_a_scan_reserves_by_its_parameters():
    reserves = {"scan.margin": 0.1, "scan.range_noise": 0.03, "scan.obstacle_speed": 0.5}
    d = Drive({**SCAN, **reserves, "scan.scan_period": 0.2}).run(1.0)
    (seen,) = d.core.sources["scan"].entries
    assert seen.conditions[0].margin == pytest.approx(0.1 + 0.06 + 0.1 + FINE)


def test_a_pose_topic_places_the_odometry_until_a_faulty_pose():
    d = Drive({"pose_source": "topic", "global_frame_id": "map"}).run(0.5)
    assert "pose: nothing received" in d.last.message
    place = np.array([5.0, 5.0, np.pi / 2])
    d.core.localization.hear_pose(place, d.now.ros, d.now, "odom")
    d.run(0.1)
    assert "pose: frame 'odom', expected 'map'" in d.last.message
    d.core.localization.hear_pose(place, d.now.ros - 0.05, d.now, "map")
    d.run(1.0)
    assert d.last.command[0] > 0.1
    d.core.localization.hear_pose(np.nan * place, d.now.ros, d.now, "map")
    d.run(0.1)
    assert "pose: got" in d.last.message
    assert not d.velocity.any()
    d.core.localization.hear_pose(d.core.pose, d.now.ros - 1e-3, d.now, "map")
    d.run(0.5)
    assert d.velocity[0] > 0.1


def test_maps_are_covered_anew_only_where_they_changed():
    given = {"observation_sources": ["map"], "map.type": "map", "map.topic": "map"}
    d = Drive(given)
    grid, cells = grid_of(np.float32(0.05), (-5.0, -5.0, 0.0), 200, 200), np.zeros((200, 200), "i2")
    assert grid.resolution == 0.05
    first = d.core.of_grid("map", Raster(grid, cells))
    d.core.hear_source("map", first, d.now.ros, d.now, "odom")
    assert d.core.of_grid("map", Raster(grid, cells)) == first  # the same objects
    changed = cells.copy()
    changed[150:160, 150] = 100
    (second,) = d.core.of_grid("map", Raster(grid, changed))
    assert second.distance([[2.525, 2.75]], 1)[0] < 0.0
    assert second.conditions[1] is first[0].conditions[1]  # "unknown" is the same


def test_a_localization_may_correct_the_pose_and_a_jump_is_none():
    """In a bounded walk, by up to .1 m and .05 rad every .2 s, as AMCL does."""
    d = Drive({"pose_source": "topic", "global_frame_id": "map"})
    rng = np.random.default_rng(0)

    def correct(d):
        if d.ticks % 20 == 0:
            off = rng.uniform(-1.0, 1.0, 3) * (0.05, 0.05, 0.025)
            d.core.localization.hear_pose(d.pose + off, d.now.ros, d.now, "map")

    d.run(60.0, each=correct)
    assert all(one.level == Level.OK for _, one in d.decisions[20:])
    d.run(0.05)
    jumped = d.pose + np.array([0.6, 0.0, 0.0])
    d.core.localization.hear_pose(jumped, d.now.ros, d.now, "map")
    d.run(0.1)
    assert "the pose has jumped" in d.last.message
    d.run(1.0)
    assert d.velocity[0] > 0.1


def test_a_plan_is_under_the_cap_that_was_set_meanwhile():
    d = Drive({"guidance": "geodesic"}).run(0.5)
    planned = d.core.planned((3.0, 0.0))
    d.core.change({"v_max": 0.6})
    d.core.take(planned)
    assert d.core.fastest < 0.6


def test_a_goal_that_comes_before_the_first_pose_waits_for_it():
    zone = {**ZONE, "zone.points": [1.5, -2.0, 2.0, -2.0, 2.0, 0.1, 1.5, 0.1]}
    d = Drive({"guidance": "geodesic", **zone}, wanted=(0.0, 0.0, 0.0))
    d.core.wait((4.0, 0.0))
    assert d.core.goal_to_plan() is None
    d.run(1.5)  # which plans, as the node does
    assert d.velocity[0] > 0.1  # guidance leads


def test_a_speed_limit_that_no_input_satisfies_is_refused():
    given = {"observation_sources": ["s"], "s.type": "speed", "s.topic": "s"}
    core = Drive(given).core
    cells = np.zeros((20, 20), dtype=np.int16)
    cells[:, 10:] = 97
    with pytest.raises(InvalidInputError, match=r"speed zone: got 0.03 m/s"):
        core.of_grid("s", Raster(grid_of(0.1, (0.0, 0.0, 0.0), 20, 20), cells))


def test_after_a_jump_the_field_is_computed_beside_the_commands(monkeypatch):
    zone = {**ZONE, "zone.points": [1.5, -2.0, 2.0, -2.0, 2.0, 0.1, 1.5, 0.1]}
    d = Drive({"guidance": "geodesic", **zone}, wanted=(0.0, 0.0, 0.0)).run(0.5)
    d.core.take(d.core.planned((4.0, 0.0)))
    d.run(1.0)
    assert d.velocity[0] > 0.1  # guidance leads
    looks, steps = [], []
    begin, step = Geodesic.begin, d.core.step

    def looked(self, *args, **named):
        looks.append(len(steps))
        return begin(self, *args, **named)

    monkeypatch.setattr(Geodesic, "begin", looked)

    def stepped(now):
        steps.append(now)
        before = len(looks)
        decision = step(now)
        assert len(looks) == before
        return decision

    d.core.step = stepped
    d.pose = d.pose + np.array([0.0, 1.0, 0.0])
    d.run(0.1)
    assert d.core.goal.tolist() == [4.0, 0.0]
    assert not looks
    d.run(1.0)
    assert len(set(looks)) == 1  # in one place between two steps
    assert d.velocity[0] > 0.1


def test_a_plan_that_is_taken_continues_from_the_last_command():
    """From rest the first command is one period of the input, not two."""
    zone = {**ZONE, "zone.points": [-0.5, -0.5, 0.5, -0.5, 0.5, 0.5, -0.5, 0.5]}
    given = {"robot": "cart", "guidance": "geodesic", "zone.priority": 2, **zone}
    first = []
    for takes in (False, True):
        d = Drive(given, start=(0.2, 0.1, 0.0), wanted=(0.0, 0.0, 0.0)).run(0.2, command=False)
        if takes:
            d.core.take(d.core.planned((4.0, 0.0)))
        d.run(0.05)
        first.append(np.linalg.norm(d.velocity * (1.0, 0.25)))
    besides = _core.ASIDE * HELD * d.core.settings.period  # guidance pushes off the zone's edge
    assert first[0] > 0.1
    assert first[1] <= first[0] + besides + 0.01


@pytest.mark.parametrize(
    "given",
    [
        {"enabled": False, "v_max": 0.001},
        {"v_max": 0.001, "scan.enabled": False},
        {"scan.enabled": False, "enabled": "no"},
        {"enabled": False, "robot": "cart"},
    ],
)
def test_parameters_that_are_set_together_are_all_taken_or_none(given):
    d = Drive(SCAN).run(0.5)
    with pytest.raises(InvalidInputError, match=r"v_max|enabled|robot"):
        d.core.change(given)
    assert d.core.enabled
    assert d.core.sources["scan"].enabled
    assert d.core.settings.v_max == 0.0
    d.core.change({"enabled": False, "v_max": 0.6, "scan.enabled": False, "use_sim_time": True})
    assert not d.core.enabled
    assert not d.core.sources["scan"].enabled
    assert d.core.settings.v_max == 0.6


NONE = "range_min and range_max: got"
FAILED = "beams failed or saw something nearer"
EMPTY = r"none of \d beams has a return"
NOT_FREE = [
    *(([1.0, 2.0, 3.0], 0.1, *limits, NONE) for limits in (
        (0.0, 0.0), (0.1, math.nan), (math.nan, 9.0), (0.1, -1.0), (5.0, 1.0), (math.inf, 9.0)
    )),
    *((ranges, 0.1, 0.1, 9.0, FAILED) for ranges in (
        [-1.0, -2.0, 3.0], [0.05, 0.05, 3.0], [math.nan, -1.0, 2.0]
    )),
    *((ranges, 0.1, 0.1, 9.0, EMPTY) for ranges in ([0.0] * 3, [0.0, math.nan, -1.0], [])),
    ([1.0, 2.0, 3.0], 0.0, 0.1, 9.0, "angle_increment: got 0 with 3 ranges"),
]  # fmt: skip


@pytest.mark.parametrize(("ranges", "step", "least", "most", "message"), NOT_FREE)
def test_an_invalid_scan_is_not_free_space(ranges, step, least, most, message):
    d = Drive(SCAN)
    with pytest.raises(InvalidInputError, match=message):
        d.core.of_scan("scan", Beams(ranges, 0.0, step, least, most))
    (seen,) = d.core.of_scan("scan", Beams([0.0, 0.0, math.inf], 0.0, 0.1, 0.1, 9.0))
    assert len(seen.points) == 0  # a driver's zero saw nothing


CORRECTED = {
    **SCAN,
    "scan.source_timeout": 1.0,
    "pose_source": "tf",
    "global_frame_id": "map",
}


def nearest(d):
    """Return the least h at the last step [m]."""
    return float(d.last.report["h"].min())


def see_wall(d, wall):
    """Let the scan see a wall at an x of odometry's frame [m]."""
    toward = np.cos(ANGLES + d.pose[2])
    with np.errstate(divide="ignore"):
        d.ranges = np.where(toward > 0.05, (wall - d.pose[0]) / toward, np.inf)


def test_a_scan_moves_with_what_is_corrected_of_the_pose():
    d = Drive(CORRECTED, wanted=(0.0, 0.0, 0.0))
    see_wall(d, 0.8)
    d.core.localization.hear_correction((1.0, -2.0, 0.3), d.now.ros)
    before = nearest(d.run(0.5))
    assert 0.4 < before < 0.8
    d.core.localization.hear_correction((1.2, -2.1, 0.35), d.now.ros)
    assert nearest(d.run(0.05, scan=False)) == pytest.approx(before, abs=1e-9)


def test_a_scan_from_before_a_correction_lies_where_it_was_seen():
    d = Drive(CORRECTED, wanted=(0.0, 0.0, 0.0))
    d.core.localization.hear_correction((0.0, 0.0, 0.0), d.now.ros)
    see_wall(d, 0.8)
    before = nearest(d.run(0.55))
    when = d.now.ros
    d.core.localization.hear_correction((0.15, 0.0, 0.0), d.now.ros)
    d.run(0.1, scan=False)
    d.say_scan(stamp=when)
    assert nearest(d.run(0.05, scan=False)) == pytest.approx(before, abs=1e-9)


@pytest.mark.parametrize("turns", [-0.5, 0.0, 0.5])
@pytest.mark.parametrize("rate", [-1.3, -0.3, 0.3, 1.3])
def test_a_robot_that_is_corrected_all_the_time_stays_out_of_what_it_sees(rate, turns):
    d = Drive(CORRECTED, wanted=(0.8, 0.0, 0.0))

    def look(d):
        passed = 0.01 * d.ticks
        d.core.localization.hear_correction((rate * passed, 0.0, turns * passed), d.now.ros)
        if d.ticks % 40 == 0:
            see_wall(d, 2.0)
            d.say_scan()

    d.run(12.0, each=look, scan=False)
    assert 1.3 < d.pose[0] + 0.3 <= 2.0
    assert d.last.report["reason"] == 0


@pytest.mark.parametrize("source", ["tf", "topic"])
def test_a_scan_from_before_odometry_began_anew_is_nowhere(source):
    d = Drive({**CORRECTED, "pose_source": source}, wanted=(0.6, 0.0, 0.0))
    leap = np.array([3.0, 0.0, 0.0])

    def place(x):
        if source == "tf":
            d.core.localization.hear_correction((x, 0.0, 0.0), d.now.ros)
        else:
            at = d.pose + np.array([x, 0.0, 0.0])
            d.core.localization.hear_pose(at, d.now.ros, d.now, "map")

    d.run(0.1, scan=False, command=False)
    place(0.0)
    see_wall(d, 0.8)
    d.run(0.5)
    before = d.pose.copy()
    d.pose = d.pose + leap  # the robot is where it was, and so is the wall
    d.run(0.04, scan=False)
    place(-3.0)
    d.run(2.5, scan=False)
    assert (d.last.command is None) or not np.any(d.last.command)
    assert np.hypot(*(d.pose - leap - before)[:2]) < 0.05  # what it takes to stand
    place(-3.0)
    see_wall(d, 3.8)
    d.say_scan()
    place(-3.0)
    d.run(0.3, scan=False)
    assert d.last.report is not None
    assert nearest(d) == pytest.approx(3.8 - d.pose[0], abs=0.05)
