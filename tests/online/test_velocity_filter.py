"""The filter in a user's loop: jittered periods, lost messages, bad data."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.velocity_loops import Cart, LoopEpisode
from hcbf_gym.barriers import BarrierSet, ConvexPolygon, Disc, HalfPlane
from hcbf_gym.envs.body import Footprint
from hcbf_gym.errors import InvalidInputError, SafetyWarning, UnknownNameError
from hcbf_gym.models import Reason
from hcbf_gym.models.clocks import AHEAD
from hcbf_gym.programs import FilterStatus
from hcbf_robots import Command, Response, Robot, VelocityFilter, Walker
from hcbf_robots.envs.walker_physics import WalkerPhysics
from hcbf_robots.ros.settings import Settings
from hcbf_robots.ros.watches import Now, Watch
from tests.robots.walkers import LEARNED

CARTS = ("cart", "holonomic-cart")
AT_REST = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
FAR = [Disc("far", 1, center=(50.0, 0.0), radius=1.0)]
STANDS = pytest.mark.filterwarnings(f"ignore:.*{Reason.RESPONSE.text[:20]}")


@pytest.mark.physics
@pytest.mark.parametrize("name", CARTS)
@pytest.mark.parametrize("rate", [20.0, 50.0, 100.0])
@pytest.mark.parametrize("attack", ["nearest", "bang-bang"])
def test_hostile_commands_with_jitter_and_lost_messages_do_not_enter(name, rate, attack):
    v_max = Walker.load(name).command.fastest
    assert LoopEpisode(name, attack, "random", 0, rate, v_max, seconds=12.0).run().least_h > 0.0


def wall_with_a_gap(width, center):
    left, right = center + 0.5 * width, center - 0.5 * width
    return [
        ConvexPolygon("left", 1, ((2.0, left), (2.15, left), (2.15, 3.0), (2.0, 3.0))),
        ConvexPolygon("right", 1, ((2.0, -3.0), (2.15, -3.0), (2.15, right), (2.0, right))),
        HalfPlane("far left", 1, (0.0, -1.0), -2.5),
        HalfPlane("far right", 1, (0.0, 1.0), -2.5),
    ]


@pytest.mark.parametrize(
    ("width", "seed", "center"),
    [(0.79, 1, -0.25 / 7.0), (0.79, 2, -0.15 / 7.0), (0.79, 7, 0.05), (0.8, 0, -0.05)],
)
def test_guidance_takes_a_cart_without_commands_through_a_gap_as_wide_as_it_needs(
    width, seed, center
):
    walker, rng, goal = Walker.load("cart"), np.random.default_rng(seed), np.array([3.5, 0.0])
    cart, least = Cart(walker), np.inf
    start = np.array([rng.uniform(-0.5, 0.8), rng.uniform(-1.5, 1.5)])
    cart.physics.reset(start, rng.uniform(-3.0, 3.0), rng)
    scene = wall_with_a_gap(width, center)
    safe = VelocityFilter(walker, scene, period=0.05, guidance="geodesic", goal=goal)
    while cart.time < 30.0:
        pose, twist = cart.odometry()
        _, report = safe.step((0.0, 0.0), pose, twist, cart.time)
        least = min(least, report["h"].min())
        end = cart.time + 0.05
        while cart.time < end - 1e-9:
            cart.step(safe.command_at(min(cart.time, end)))
        point = pose[:2] + walker.command.look_ahead * np.array([np.cos(pose[2]), np.sin(pose[2])])
        if np.hypot(*(point - goal)) < 0.3:
            break
    assert cart.time < 30.0
    assert least > 0.0


@STANDS
@pytest.mark.parametrize("name", CARTS)
def test_a_harmless_command_passes_and_its_acceleration_is_bounded(name):
    safe = VelocityFilter(name, FAR, period=0.05)
    wanted = np.zeros(
        len(safe.step(np.zeros(Walker.load(name).command.limits.size), *AT_REST, 0.0)[0])
    )
    wanted[0] = 0.5
    given = [safe.step(wanted, *AT_REST, 0.05 * k)[0][0] for k in range(1, 30)]
    assert given[0] < 0.3
    assert given[-1] == pytest.approx(0.5, rel=0.05)


@STANDS
def test_the_command_is_zero_within_one_period_when_data_end():
    safe = VelocityFilter("cart", [HalfPlane("wall", 1, (-1.0, 0.0), -9.0)], period=0.05)
    for k in range(10):
        command, report = safe.step((0.6, 0.2), *AT_REST, 0.05 * k)
    assert command[0] > 0.1
    assert report["valid_until"] == pytest.approx(0.45 + 0.05)
    np.testing.assert_array_equal(safe.command_at(0.49), command)
    np.testing.assert_array_equal(safe.command_at(0.5001), np.zeros(2))


BAD = {
    "no pose": (None, (0.0, 0.0, 0.0), 0.5, Reason.STATE),
    "no twist": ((0.0, 0.0, 0.0), None, 0.5, Reason.STATE),
    "NaN": ((0.0, math.nan, 0.0), (0.0, 0.0, 0.0), 0.5, Reason.STATE),
    "a pose beyond all": ((1e300, 0.0, 0.0), (0.0, 0.0, 0.0), 0.5, Reason.STATE),
    "a heading beyond all": ((0.0, 0.0, 1e300), (0.0, 0.0, 0.0), 0.5, Reason.STATE),
    "a speed beyond all": ((0.0, 0.0, 0.0), (1e9, 0.0, 0.0), 0.5, Reason.STATE),
    "a short pose": ((0.0, 0.0), (0.0, 0.0, 0.0), 0.5, Reason.STATE),
    "text": ("here", (0.0, 0.0, 0.0), 0.5, Reason.STATE),
    "the same time again": (*AT_REST, 0.45, Reason.CLOCK),
    "a time that goes back": (*AT_REST, 0.3, Reason.CLOCK),
    "no time": (*AT_REST, math.nan, Reason.CLOCK),
}


@STANDS
@pytest.mark.parametrize("bad", BAD)
def test_bad_data_brake_at_once_and_good_ones_go_on(bad):
    safe = VelocityFilter("cart", FAR, period=0.05)
    for k in range(10):
        safe.step((0.6, 0.2), *AT_REST, 0.05 * k)
    pose, twist, time, reason = BAD[bad]
    with pytest.warns(SafetyWarning, match="brakes"):
        command, report = safe.step((0.6, 0.2), pose, twist, time)
    np.testing.assert_array_equal(command, np.zeros(2))
    assert report["status"] == FilterStatus.BACKUP
    assert report["reason"] == reason
    command, report = safe.step((0.6, 0.2), *AT_REST, 0.55)
    assert report["status"] != FilterStatus.BACKUP
    assert command[0] > 0.0


@pytest.mark.parametrize("ahead", [1e-3, 0.05, 0.1])
@pytest.mark.parametrize("repeats", [1, 3])
def test_a_stamp_that_is_a_little_ahead_is_of_now(ahead, repeats):
    def drive(off):
        safe = VelocityFilter("cart", [Disc("far", 1, center=(3.0, 0.0), radius=1.0)], max_age=0.2)
        x, given, reasons, commands = 0.0, np.zeros(2), [], []
        for k in range(60):
            if k % repeats == 0:
                sample = (x, 0.0, 0.0), (given[0], 0.0, 0.0), 1e3 + 0.05 * k + off
            given, report = safe.step((0.6, 0.0), *sample, now=1e3 + 0.05 * k)
            x += 0.05 * given[0]
            commands.append(given[0])
            reasons.append(report["reason"])
        return commands, reasons

    commands, reasons = drive(ahead)
    assert not any(reasons)
    np.testing.assert_allclose(commands, drive(0.0)[0], atol=0.1)
    assert max(commands) > 0.5


def test_the_filter_and_the_node_accept_the_same_stamps():
    assert Settings().transform_tolerance == AHEAD
    for ahead in (0.5 * AHEAD, AHEAD, 1.01 * AHEAD, 10.0):
        watch = Watch("odometry", 0.2, Settings().transform_tolerance)
        heard = watch.hear(1e3 + ahead, Now(1e3, 0.0))
        safe = VelocityFilter("cart", [])
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            _, report = safe.step((0.6, 0.0), *AT_REST, 1e3 + ahead, now=1e3)
        assert heard == (report["reason"] != Reason.AGE) == (ahead <= AHEAD)
        fault = watch.fault(Now(1e3, 0.0))
        if fault is not None:
            assert any(fault.message in str(one.message) for one in raised)


@STANDS
def test_a_clock_that_goes_back_leaves_no_command():
    safe = VelocityFilter("cart", FAR, period=0.05)
    for k in range(10):
        given, _ = safe.step((0.6, 0.2), *AT_REST, 10.0 + 0.05 * k)
    np.testing.assert_array_equal(safe.command_at(10.45), given)
    for now in (10.4, 0.0, -math.inf, math.nan):
        np.testing.assert_array_equal(safe.command_at(now), np.zeros(2))


@pytest.mark.parametrize("huge", [1e300, -1.7e308])
def test_a_huge_command_is_clipped_to_the_greatest(huge):
    safe = VelocityFilter("cart", FAR, period=0.05)
    command, report = safe.step((huge, huge), *AT_REST, 0.0)
    assert np.isfinite(command).all()
    assert report["status"] <= FilterStatus.SAFE


def test_bad_commands_and_arguments_are_refused():
    wall = [HalfPlane("wall", 1, (-1.0, 0.0), -9.0)]
    safe = VelocityFilter("cart", wall)
    for command in ((math.nan, 0.0), (1.0,), "go"):
        with pytest.raises(InvalidInputError, match="command"):
            safe.step(command, *AT_REST, 0.0)
    with pytest.raises(InvalidInputError, match="v_max"):
        VelocityFilter("cart", wall, v_max=9.0)
    with pytest.raises(InvalidInputError, match="robot"):
        VelocityFilter(3, wall)
    with pytest.raises(UnknownNameError, match="cart"):
        VelocityFilter("tractor", wall)
    with pytest.raises(InvalidInputError, match="gamma"):
        VelocityFilter("cart", wall, gamma=1.0)


@pytest.mark.parametrize(
    "other",
    [
        Robot(Command(0.5, 1.0, sideways=0.3)),
        Robot(Command(0.5, 1.0, look_ahead=0.2)),
        Robot(Command(0.5, 1.0, look_ahead=0.1), Response(time_constant=0.1)),
    ],
)
def test_a_filter_does_not_take_the_place_of_one_of_another_robot(other):
    robot = Robot(Command(0.5, 1.0, look_ahead=0.1))
    safe = VelocityFilter(robot, FAR)
    with pytest.raises(InvalidInputError, match=r"other: got a filter of Robot.*expected"):
        safe.go_on_from(VelocityFilter(other, FAR))
    safe.go_on_from(VelocityFilter(replace(robot, reach=0.1), FAR))
    assert safe.step((0.1, 0.0), *AT_REST, 0.0)[1]["status"] == FilterStatus.NOMINAL


@STANDS
def test_a_lost_message_forgets_nothing_that_is_under_way():
    safe = VelocityFilter("cart", FAR, period=0.01)
    for k in range(10):
        before, _ = safe.step((1.0, 0.0), *AT_REST, 0.01 * k)  # the robot has not moved yet
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        after, report = safe.step((1.0, 0.0), *AT_REST, 0.105)
    assert report["status"] != FilterStatus.BACKUP
    assert after[0] > before[0]
    later, _ = safe.step((1.0, 0.0), *AT_REST, 2.0)
    assert later[0] < before[0]  # after a long pause the model begins with what is measured


def test_invalid_barriers_and_limits_are_refused_at_construction():
    for barriers in (None, 3, "wall", [1], HalfPlane("wall", 1, (-1.0, 0.0), -2.0)):
        with pytest.raises(InvalidInputError, match="barriers"):
            VelocityFilter("cart", barriers)
    with pytest.raises(InvalidInputError, match="one period"):
        VelocityFilter("cart", [], period=0.2, v_max=0.5)


@pytest.mark.parametrize("name", [*CARTS, *LEARNED])
def test_the_body_radius_of_the_environment_is_reserved(name):
    contract = Walker.load(name)
    walker = replace(contract, body=replace(contract.body, reach=None))
    physics = WalkerPhysics(walker)
    derived = Footprint(physics.model, physics.trunk).radius(physics.home_joints)
    assert walker.reach == pytest.approx(derived)
    still = np.zeros(len(walker.command.limits)), *AT_REST, 0.0
    whole, point = (
        VelocityFilter(walker, FAR, radius=radius).step(*still)[1]["margin"][0]
        for radius in (None, 0.0)
    )
    assert whole - point == pytest.approx(derived)


def test_scenes_of_an_environment_are_refused_and_never_lose_the_speed_limit():
    safe = VelocityFilter("cart", [], period=0.05, v_max=0.8)
    safe.step((0.6, 0.0), *AT_REST, 0.0)
    safe.barriers = BarrierSet([[Disc("far", 1, center=(50.0, 0.0), radius=1.0)]], is_placed=True)
    with pytest.warns(SafetyWarning, match="brakes"):
        command, report = safe.step((0.6, 0.0), *AT_REST, 0.05)
    np.testing.assert_array_equal(command, np.zeros(2))
    assert report["reason"] == Reason.BARRIERS
