"""The filter in a user's own loop: jittered periods, lost messages, bad data."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

import hcbf_robots
from hcbf_gym import certificates, scenarios
from hcbf_gym.barriers import BarrierSet, Disc, HalfPlane, SpeedLimit
from hcbf_gym.envs.body import Footprint
from hcbf_gym.envs.drive import tracked
from hcbf_gym.errors import InvalidInputError, SafetyWarning, UnknownNameError
from hcbf_gym.models.clocks import AHEAD
from hcbf_gym.models.plant import Reason
from hcbf_gym.programs import FilterStatus
from hcbf_robots.envs.walker_physics import WalkerPhysics
from hcbf_robots.online import Robot, VelocityFilter
from hcbf_robots.ros.parameters import Settings
from hcbf_robots.ros.watches import Now, Watch
from hcbf_robots.walkers import Walker
from hcbf_robots.walkers.walker_parts import Command
from tests.robots.walkers import LEARNED

CARTS = ("cart", "holonomic-cart")
AT_REST = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


class Cart:
    """A simulated cart that is told commands at any time and says where it is."""

    def __init__(self, name, seed):
        self.walker = Walker.load(name)
        self.physics = WalkerPhysics(self.walker)
        k = len(self.walker.command.limits)
        self._controller = self.walker.controller((k, k), self.physics.model)
        self.physics.reset(np.zeros(2), 0.0, np.random.default_rng(seed))
        self._base = np.zeros((1, 13))

    @property
    def time(self):
        return self.physics.data.time

    def go(self, command, until):
        """Advance to a time [s] under a command; return (k, 2) the path of the robot's origin."""
        path = []
        while self.time < until - 1e-9:
            self.physics.step(self._controller(command))
            self.physics.base(self._base[0])
            path.append(tracked(self._base, 0.0)[0, :2])
        return np.array(path).reshape(-1, 2)

    def says(self):
        """Return pose and twist as odometry has them."""
        qpos, qvel, yaw = self.physics.data.qpos, self.physics.data.qvel, self.physics.yaw
        cos, sin = math.cos(yaw), math.sin(yaw)
        twist = cos * qvel[0] + sin * qvel[1], cos * qvel[1] - sin * qvel[0], qvel[5]
        return (qpos[0], qpos[1], yaw), twist


def straight_at(barrier, x, y, yaw, walker):
    """Return the greatest command towards a region's nearest point."""
    gradient = barrier.jet(np.array([x, y, 0.0, 0.0]), 0.0).gradient[:2]
    vx, vy = -walker.command.forward * gradient / np.linalg.norm(gradient)
    cos, sin = math.cos(yaw), math.sin(yaw)
    ahead, aside = cos * vx + sin * vy, cos * vy - sin * vx
    if walker.command.look_ahead is not None:
        return np.array([ahead, aside / walker.command.look_ahead])
    return np.array([ahead, aside, 0.0])


def least_h(name, rate, seed, seconds=12.0):
    """Return the least h of the strict regions in a hostile run with jitter and lost messages."""
    rng = np.random.default_rng(seed)
    scene = scenarios.make("random", np.random.default_rng(seed))
    cart = Cart(name, seed)
    barriers = [b for b in scene.barriers if b.priority == 1]
    period = 1.3 / rate
    door = VelocityFilter(cart.walker, scene.barriers, period=period, radius=0.0)
    least, sign, until = math.inf, 1.0, 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        while cart.time < seconds:
            pose, twist = cart.says()
            if rng.random() >= 0.1 or cart.time == 0.0:
                at = [b.h(np.array([pose[0], pose[1], 0.0, 0.0]), 0.0) for b in barriers]
                if cart.time >= until:
                    sign, until = rng.choice([-1.0, 1.0, 1.0]), cart.time + rng.uniform(0.3, 1.5)
                nearest = barriers[int(np.argmin(at))]
                command = sign * straight_at(nearest, *pose, cart.walker)
                door.step(command, pose, twist, cart.time)
            end = cart.time + rng.uniform(0.7, 1.3) / rate
            while cart.time < end - 1e-9:  # the robot's own loop, faster than data come
                tick = min(end, cart.time + float(cart.physics.model.opt.timestep))
                for x, y in cart.go(door.command_at(cart.time), tick):
                    state = np.array([x, y, 0.0, 0.0])
                    least = min(least, *(b.h(state, cart.time) for b in barriers))
    return least


@pytest.mark.physics
@pytest.mark.parametrize("name", CARTS)
@pytest.mark.parametrize("rate", [20.0, 50.0, 100.0])
def test_hostile_commands_with_jitter_and_lost_messages_do_not_enter(name, rate):
    assert min(least_h(name, rate, seed) for seed in range(2)) > 0.0


@pytest.mark.filterwarnings("ignore:.*does not do what it is told")  # it stands
@pytest.mark.parametrize("name", CARTS)
def test_a_harmless_command_passes_and_its_acceleration_is_bounded(name):
    door = VelocityFilter(name, [Disc("far", 1, center=(50.0, 0.0), radius=1.0)], period=0.05)
    wanted = np.zeros(
        len(door.step(np.zeros(Walker.load(name).command.limits.size), *AT_REST, 0.0)[0])
    )
    wanted[0] = 0.5
    told = [door.step(wanted, *AT_REST, 0.05 * k)[0][0] for k in range(1, 30)]
    assert told[0] < 0.3
    assert told[-1] == pytest.approx(0.5, rel=0.05)


@pytest.mark.filterwarnings("ignore:.*does not do what it is told")  # it stands
def test_the_command_is_zero_within_one_period_when_data_end():
    door = VelocityFilter("cart", [HalfPlane("wall", 1, (-1.0, 0.0), -9.0)], period=0.05)
    for k in range(10):
        command, report = door.step((0.6, 0.2), *AT_REST, 0.05 * k)
    assert command[0] > 0.1
    assert report["valid_until"] == pytest.approx(0.45 + 0.05)
    np.testing.assert_array_equal(door.command_at(0.49), command)
    np.testing.assert_array_equal(door.command_at(0.5001), np.zeros(2))


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


@pytest.mark.filterwarnings("ignore:.*does not do what it is told")  # it stands
@pytest.mark.parametrize("bad", BAD)
def test_bad_data_brake_at_once_and_good_ones_go_on(bad):
    door = VelocityFilter("cart", [Disc("far", 1, center=(50.0, 0.0), radius=1.0)], period=0.05)
    for k in range(10):
        door.step((0.6, 0.2), *AT_REST, 0.05 * k)
    pose, twist, time, reason = BAD[bad]
    with pytest.warns(SafetyWarning, match="brakes"):
        command, report = door.step((0.6, 0.2), pose, twist, time)
    np.testing.assert_array_equal(command, np.zeros(2))
    assert report["status"] == FilterStatus.BACKUP
    assert report["reason"] == reason
    command, report = door.step((0.6, 0.2), *AT_REST, 0.55)
    assert report["status"] != FilterStatus.BACKUP
    assert command[0] > 0.0


@pytest.mark.filterwarnings("ignore:.*does not do what it is told")  # it stands
def test_old_data_brake():
    door = VelocityFilter("cart", [Disc("far", 1, center=(50.0, 0.0), radius=1.0)], max_age=0.1)
    assert door.step((0.6, 0.0), *AT_REST, 0.0, now=0.05)[0][0] > 0.0
    for now, says in ((0.2, "0.15 s old"), (-0.06, "0.11 s ahead of the clock")):
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            command, report = door.step((0.6, 0.0), *AT_REST, 0.05, now=now)
        assert any(says in str(one.message) for one in raised)
        assert report["reason"] == Reason.AGE
        np.testing.assert_array_equal(command, np.zeros(2))


@pytest.mark.parametrize("ahead", [1e-3, 0.05, 0.1])
@pytest.mark.parametrize("repeats", [1, 3])
def test_a_stamp_that_is_a_little_ahead_is_of_now(ahead, repeats):
    def drive(off):
        door = VelocityFilter("cart", [Disc("far", 1, center=(3.0, 0.0), radius=1.0)], max_age=0.2)
        x, told, reasons, commands = 0.0, np.zeros(2), [], []
        for k in range(60):
            if k % repeats == 0:
                sample = (x, 0.0, 0.0), (told[0], 0.0, 0.0), 1e3 + 0.05 * k + off
            told, report = door.step((0.6, 0.0), *sample, now=1e3 + 0.05 * k)
            x += 0.05 * told[0]
            commands.append(told[0])
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
        door = VelocityFilter("cart", [])
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            _, report = door.step((0.6, 0.0), *AT_REST, 1e3 + ahead, now=1e3)
        assert heard == (report["reason"] != Reason.AGE) == (ahead <= AHEAD)
        fault = watch.fault(Now(1e3, 0.0))
        if fault is not None:
            assert any(fault.says in str(one.message) for one in raised)


@pytest.mark.filterwarnings("ignore:.*does not do what it is told")  # it stands
def test_a_clock_that_goes_back_leaves_no_command():
    door = VelocityFilter("cart", [Disc("far", 1, center=(50.0, 0.0), radius=1.0)], period=0.05)
    for k in range(10):
        told, _ = door.step((0.6, 0.2), *AT_REST, 10.0 + 0.05 * k)
    np.testing.assert_array_equal(door.command_at(10.45), told)
    for now in (10.4, 0.0, -math.inf, math.nan):
        np.testing.assert_array_equal(door.command_at(now), np.zeros(2))


def test_barriers_that_no_filter_can_begin_with_brake_until_there_are_others():
    far = [Disc("far", 1, center=(50.0, 0.0), radius=1.0)]
    door = VelocityFilter("cart", far, period=0.05)
    door.barriers = [*far, SpeedLimit("slow", 1, 0.01)]
    with (
        pytest.warns(SafetyWarning, match="brakes until that ends"),
        pytest.warns(SafetyWarning, match="no speed is left"),
    ):
        command, report = door.step((0.6, 0.2), *AT_REST, 0.0)
    np.testing.assert_array_equal(command, np.zeros(2))
    assert (report["status"], report["reason"]) == (FilterStatus.BACKUP, Reason.BARRIERS)
    door.barriers = far
    assert door.step((0.6, 0.2), *AT_REST, 0.05)[1]["status"] <= FilterStatus.SAFE


@pytest.mark.parametrize("huge", [1e300, -1.7e308])
def test_a_command_beyond_all_is_one_for_the_most_that_is_possible(huge):
    door = VelocityFilter("cart", [Disc("far", 1, center=(50.0, 0.0), radius=1.0)], period=0.05)
    command, report = door.step((huge, huge), *AT_REST, 0.0)
    assert np.isfinite(command).all()
    assert report["status"] <= FilterStatus.SAFE


def test_bad_commands_and_arguments_are_refused():
    wall = [HalfPlane("wall", 1, (-1.0, 0.0), -9.0)]
    door = VelocityFilter("cart", wall)
    for command in ((math.nan, 0.0), (1.0,), "go"):
        with pytest.raises(InvalidInputError, match="command"):
            door.step(command, *AT_REST, 0.0)
    with pytest.raises(InvalidInputError, match="v_max"):
        VelocityFilter("cart", wall, v_max=9.0)
    with pytest.raises(InvalidInputError, match="robot"):
        VelocityFilter(3, wall)
    with pytest.raises(UnknownNameError, match="cart"):
        VelocityFilter("tractor", wall)
    with pytest.raises(InvalidInputError, match="gamma"):
        VelocityFilter("cart", wall, gamma=1.0)


@pytest.mark.filterwarnings("ignore:.*does not do what it is told")  # it stands
def test_a_lost_message_forgets_nothing_that_is_under_way():
    door = VelocityFilter("cart", [Disc("far", 1, center=(50.0, 0.0), radius=1.0)], period=0.01)
    for k in range(10):
        before, _ = door.step((1.0, 0.0), *AT_REST, 0.01 * k)  # the robot has not moved yet
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        after, report = door.step((1.0, 0.0), *AT_REST, 0.105)
    assert report["status"] != FilterStatus.BACKUP
    assert after[0] > before[0]
    later, _ = door.step((1.0, 0.0), *AT_REST, 2.0)
    assert later[0] < before[0]  # after a long pause the model begins with what is measured


def test_barriers_that_are_none_or_out_of_reach_are_refused_at_construction():
    for barriers in (None, 3, "wall", [1], HalfPlane("wall", 1, (-1.0, 0.0), -2.0)):
        with pytest.raises(InvalidInputError, match="barriers"):
            VelocityFilter("cart", barriers)
    with pytest.raises(InvalidInputError, match="one period"):
        VelocityFilter("cart", [], period=0.2, v_max=0.5)


def test_a_robot_without_a_contract_is_taken_for_slow():
    wall = [HalfPlane("wall", 1, (-1.0, 0.0), -2.0)]
    known = VelocityFilter("cart", wall, radius=0.0)
    command = Command(forward=1.2, turn=5.0, look_ahead=0.25)
    unknown = VelocityFilter(Robot(command), wall, radius=0.0)
    reports = [f.step((1.0, 0.0), *AT_REST, 0.0)[1] for f in (known, unknown)]
    assert reports[1]["margin"][0] > reports[0]["margin"][0]


def test_it_is_a_public_name():
    assert hcbf_robots.VelocityFilter is VelocityFilter


def test_a_robot_with_a_certificate_reserves_no_less_here():
    found = certificates.shipped()["cart"].margins
    door = VelocityFilter("cart", [Disc("far", 1, center=(50.0, 0.0), radius=1.0)], radius=0.0)
    _, report = door.step((0.0, 0.0), *AT_REST, 0.0)
    assert report["margin"][0] >= found.distance


@pytest.mark.parametrize("name", [*CARTS, *LEARNED])
def test_what_the_environment_derives_of_a_body_is_held_outside_here_too(name):
    contract = Walker.load(name)
    walker = replace(contract, body=replace(contract.body, reach=None))
    physics = WalkerPhysics(walker)
    derived = Footprint(physics.model, physics.trunk).radius(physics.home_joints)
    assert walker.reach == pytest.approx(derived)
    far = [Disc("far", 1, center=(50.0, 0.0), radius=1.0)]
    still = np.zeros(len(walker.command.limits)), *AT_REST, 0.0
    whole, point = (
        VelocityFilter(walker, far, radius=radius).step(*still)[1]["margin"][0]
        for radius in (None, 0.0)
    )
    assert whole - point == pytest.approx(derived)


def test_scenes_of_an_environment_are_refused_and_never_lose_the_speed_limit():
    door = VelocityFilter("cart", [], period=0.05, v_max=0.8)
    door.step((0.6, 0.0), *AT_REST, 0.0)
    door.barriers = BarrierSet([[Disc("far", 1, center=(50.0, 0.0), radius=1.0)]], is_placed=True)
    with pytest.warns(SafetyWarning, match="brakes"):
        command, report = door.step((0.6, 0.0), *AT_REST, 0.05)
    np.testing.assert_array_equal(command, np.zeros(2))
    assert report["reason"] == Reason.BARRIERS
