"""What the compiled filter does where it knows nothing: it brakes, says why, and goes on after."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from point_mass import AHEAD, DISC, PERIOD, Point, filtered, quietly

import hcbf_gym
from hcbf_gym import barriers, models, wrappers
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.plant import Estimate, Reason
from hcbf_gym.programs import FilterStatus

BAD = [
    np.full(4, np.nan),
    np.array([0.0, 0.0, np.inf, 0.0]),
    None,
    0.5,
    "state",
    np.array(["1.0"] * 4),
    [True] * 4,
    np.zeros(3),
    np.zeros((2, 4)),
    np.zeros(4) * 1j,
    [[1.0], 2.0],
    {},
    Estimate(np.zeros(4), time=np.nan),
    Estimate(np.zeros(4), time="late"),
    Estimate(np.zeros(4), covariance=np.full((4, 4), np.nan)),
    Estimate(np.zeros(4), covariance=-np.eye(4)),
    Estimate(np.zeros(4), covariance=np.eye(2)),
    Estimate(np.zeros(4), covariance=np.ones((4, 4)) - 0.5 * np.eye(4)),
    Estimate(np.zeros(4), lag=np.full(4, np.inf)),
    Estimate(np.zeros(4), model=np.zeros(2)),
    Estimate(np.zeros(4), age=np.nan),
    Estimate(np.zeros(4), age=-1.0),
    Estimate(np.zeros(4), age=np.inf),
    Estimate(np.zeros(4), age=np.array([np.inf])),
    Estimate(np.zeros(4), fault=3),
    Estimate(np.zeros(4), fault="slip"),
]


def reason_of(bad):
    """Which reason a bad estimate is braked for."""
    estimate = bad if isinstance(bad, Estimate) else Estimate(bad)
    if estimate.time is not None:
        return Reason.CLOCK
    return Reason.STATE if estimate.age is None else Reason.AGE


@pytest.mark.parametrize("bad", BAD, ids=lambda bad: repr(bad)[:40])
@pytest.mark.parametrize("after", [0, 1, 20])
def test_a_state_that_is_none_brakes_until_a_good_one_comes(bad, after):
    told = []
    env = filtered(lambda x: bad if told else x)
    env.reset(seed=0)
    for _ in range(after):
        assert quietly(env)["status"] <= FilterStatus.RELAXED
    told.append(bad)
    for _ in range(30):
        before = np.linalg.norm(env.unwrapped.x[2:])
        report = quietly(env)
        assert report["status"] == FilterStatus.BACKUP
        assert report["reason"] == reason_of(bad)
        assert np.linalg.norm(env.unwrapped.x[2:]) <= max(0.0, before - 0.99 * 5.0 * PERIOD) + 1e-9
    assert np.linalg.norm(env.unwrapped.x[2:]) <= 1e-9  # it stands
    told.clear()
    report = quietly(env)
    assert report["status"] < FilterStatus.BACKUP
    assert report["reason"] == 0


def test_it_warns_once_of_each_reason():
    told = []
    env = filtered(lambda x: np.full(4, np.nan) if told else x)
    env.reset(seed=0)
    told.append(1)
    with pytest.warns(UserWarning, match="not finite"):
        env.step(AHEAD)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env.step(AHEAD)


def test_a_bad_first_state_is_told_at_the_reset():
    env = filtered(lambda x: np.full(4, np.nan))
    with pytest.warns(UserWarning, match="not finite"):
        _, info = env.reset(seed=0)
    assert info["safety_filter"]["status"] == FilterStatus.BACKUP
    report = quietly(env)
    np.testing.assert_array_equal(report["u_safe"], [0.0, 0.0])


def test_a_state_brakes_as_its_age_passes_the_bound():
    age = [0.0]
    env = filtered(lambda x: Estimate(x, age=age[0]), max_age=0.1)
    env.reset(seed=0)
    for given_age, braked in ((0.0, False), (0.1, False), (0.1001, True), (0.05, False)):
        age[0] = given_age
        report = quietly(env)
        assert (report["status"] == FilterStatus.BACKUP) == braked
        assert report["reason"] == (Reason.AGE if braked else 0)


def test_a_time_that_does_not_go_on_brakes():
    times = iter([0.0, 0.0, 0.02, 0.02, 0.01, 0.04])
    env = filtered(lambda x: Estimate(x, time=next(times)))
    env.reset(seed=0)
    said = [quietly(env)["reason"] for _ in range(5)]
    assert said == [0, 0, Reason.CLOCK, Reason.CLOCK, 0]


class Own(barriers.PlanarBarrier):
    """A user's own wall."""

    def planar_jet(self, q):
        return q[1] + 3.0, np.array([0.0, 1.0]), np.zeros((2, 2))


def test_an_action_that_is_refused_is_no_step():
    env = filtered(lambda x: Estimate(x, time=env.unwrapped.clock), listed=(Own("own", 1),))
    env.unwrapped.clock = 0.0
    env.reset(seed=0)
    for _ in range(3):
        with pytest.raises(InvalidInputError, match="finite"):
            env.step(np.array([np.nan, 0.0]))
    assert quietly(env)["reason"] == 0


def test_the_brake_of_the_plant_replaces_the_models():
    told = []
    env = filtered(lambda x: None if told else x, brake=lambda x: [-1.0, 7.0])
    env.reset(seed=0)
    env.step(AHEAD)
    told.append(1)
    np.testing.assert_allclose(quietly(env)["u_safe"], [-1.0, 5.0])
    env = filtered(lambda x: None, brake=lambda x: np.full(2, np.nan))
    with pytest.warns(UserWarning, match="not finite"):
        env.reset(seed=0)
    np.testing.assert_array_equal(quietly(env)["u_safe"], [0.0, 0.0])


def test_the_users_brake_is_asked_with_a_state_that_is_known_and_may_change_its_copy():
    asked = []

    def brake(x):
        asked.append(x.copy())
        x[:] = np.nan
        return np.array([-1.0, 0.0])

    told = [None]
    env = filtered(lambda x: told[0], brake=brake, on_alarm="brake")
    with pytest.warns(UserWarning, match="not finite"):
        env.reset(seed=0)
    np.testing.assert_array_equal(quietly(env)["u_safe"], [0.0, 0.0])
    assert not asked
    told[0] = Estimate(np.array([0.0, 0.0, 0.5, 0.0]), time=1.0, fault=int(Reason.SLIP))
    report = quietly(env)
    np.testing.assert_array_equal(report["u_safe"], [-1.0, 0.0])
    np.testing.assert_array_equal(asked, [told[0].x])
    assert report["status"] == FilterStatus.BACKUP
    assert not report["slack"].any()


def test_a_list_that_is_changed_in_place_is_seen():
    listed = [barriers.Disc("far", 1, center=(50.0, 0.0), radius=0.5)]
    env = filtered(listed=lambda: listed)
    env.reset(seed=0)
    assert quietly(env)["status"] == FilterStatus.NOMINAL
    listed[0] = barriers.Disc("near", 1, center=(0.6, 0.0), radius=0.5)
    assert quietly(env)["status"] != FilterStatus.NOMINAL
    for _ in range(200):
        quietly(env)
    assert np.hypot(env.unwrapped.x[0] - 0.6, env.unwrapped.x[1]) >= 0.5
    listed.clear()
    report = quietly(env)
    assert report["status"] == FilterStatus.NOMINAL
    assert report["slack"].shape == (0,)
    listed.append(barriers.Disc("soft", 2, center=(0.0, 0.0), radius=5.0))  # no rank 1 in sight
    assert quietly(env)["status"] in (FilterStatus.RELAXED, FilterStatus.SAFE)


@pytest.mark.parametrize("bad", [None, 3.0, "disc", [1.0], [None], {"disc": DISC}, [[DISC]]])
def test_a_reader_that_returns_no_barriers_brakes(bad):
    told = []
    env = filtered(listed=lambda: bad if told else [DISC])
    env.reset(seed=0)
    for _ in range(10):
        quietly(env)
    told.append(1)
    for _ in range(15):
        report = quietly(env)
        assert (report["status"], report["reason"]) == (FilterStatus.BACKUP, Reason.BARRIERS)
    assert np.linalg.norm(env.unwrapped.x[2:]) <= 1e-9


@pytest.mark.parametrize("bad", [None, 3.0, "disc", [1.0], [None], {"disc": DISC}])
def test_barriers_that_are_none_are_refused_at_construction(bad):
    plant = hcbf_gym.Plant(models.DoubleIntegrator(), bad, lambda *_: np.zeros(4), period=PERIOD)
    with pytest.raises(InvalidInputError, match="expected"):
        wrappers.SafetyFilter(Point(), plant=plant)


class Broken(barriers.Barrier):
    """A user's own barrier whose derivatives are no numbers."""

    def jet(self, x, t=0.0):
        return barriers.Jet(1.0, np.full(4, np.nan), np.zeros((4, 4)), 0.0, np.zeros(4), 0.0)


def test_a_barrier_whose_jet_is_not_finite_brakes():
    env = filtered(listed=(DISC, Broken("broken", 1)))
    with pytest.warns(UserWarning, match="barriers"):
        env.reset(seed=0)
    report = quietly(env)
    assert (report["status"], report["reason"]) == (FilterStatus.BACKUP, Reason.BARRIERS)
    np.testing.assert_array_equal(report["u_safe"], [0.0, 0.0])


def test_without_a_period_it_filters_and_stops_pushing_where_it_knows_nothing():
    told = []
    with pytest.warns(UserWarning, match="period is not known"):
        env = filtered(lambda x: None if told else x, period=None)
    env.reset(seed=0)
    for _ in range(300):
        assert quietly(env)["status"] <= FilterStatus.RELAXED
    assert env.unwrapped.x[0] <= 1.5
    told.append(1)
    np.testing.assert_array_equal(quietly(env)["u_safe"], [0.0, 0.0])


SENSORS = {
    "frozen": lambda: lambda x: np.array([0.3, 0.1, *x[2:]]),
    "swapped": lambda: lambda x: np.array([x[1], x[0], *x[2:]]),
    "half": lambda: lambda x: np.array([0.5 * x[0], 0.5 * x[1], *x[2:]]),
    "twice": lambda: lambda x: np.array([2.0 * x[0], 2.0 * x[1], *x[2:]]),
    "a fifth more": lambda: lambda x: np.array([1.2 * x[0], 1.2 * x[1], *x[2:]]),
    "velocity of nobody": lambda: lambda x: np.array([*x[:2], 0.0, 0.0]),
}


def late(steps):
    waiting = [np.zeros(2)] * steps

    def told(x):
        waiting.append(x[:2].copy())
        return np.array([*waiting.pop(0), *x[2:]])

    return told


def seconds_until_warned(sensor, policy, most=3.0):
    env = filtered(sensor, listed=(barriers.Disc("far", 1, center=(90.0, 0.0), radius=0.5),))
    env.reset(seed=0)
    moving = 0.0
    for step in range(round(most / PERIOD)):
        report = quietly(env, policy(step * PERIOD, env.unwrapped.x))
        moving += PERIOD * (np.linalg.norm(env.unwrapped.x[2:]) > 0.1)
        if report["reason"]:
            return moving
    return np.inf


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_position_that_does_not_move_as_the_velocity_says_is_noticed(sensor):
    def drives(t, x):
        return np.clip(5.0 * (np.array([0.8, 0.1]) - x[2:]), -2.0, 2.0)

    assert seconds_until_warned(SENSORS[sensor](), drives) <= 0.5


def test_a_position_that_comes_late_is_noticed_at_a_change_of_speed():
    def starts(t, x):
        return np.clip(5.0 * (np.array([0.8, 0.0]) - x[2:]), -2.0, 2.0)

    assert seconds_until_warned(late(5), starts) <= 0.5


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_a_true_state_is_never_suspected_whatever_is_done(seed):
    rng = np.random.default_rng(seed)
    held = iter(rng.uniform(-5.0, 5.0, (100, 2)).repeat(rng.integers(1, 20), axis=0))
    assert seconds_until_warned(lambda x: x, lambda t, x: next(held), 1.9) == np.inf


def test_noise_that_is_declared_is_no_alarm():
    rng = np.random.default_rng(0)

    def noisy(x):
        return Estimate(
            x + rng.normal(0.0, [0.02, 0.02, 0.03, 0.03]),
            covariance=np.diag([0.02, 0.02, 0.03, 0.03]) ** 2,
            model=None,
        )

    held = iter(rng.uniform(-2.0, 2.0, (40, 2)).repeat(25, axis=0))
    env = filtered(noisy, listed=(barriers.Disc("far", 1, center=(90.0, 0.0), radius=0.5),))
    env.reset(seed=0)
    reasons = {int(quietly(env, next(held))["reason"]) for _ in range(900)}
    assert Reason.MOTION not in reasons


@pytest.mark.parametrize("solver", [None, "daqp"])
@pytest.mark.parametrize("reason", [Reason.SLIP, Reason.LAG, Reason.LIFT, Reason.INPUT])
def test_after_an_alarm_the_rows_still_hold(reason, solver):
    comes = barriers.Disc("comes", 1, center=(2.0, 0.0), radius=0.5, velocity=(-0.3, 0.05))
    fault = [0]
    env = filtered(
        lambda x: Estimate(x, fault=fault[0]), listed=(comes,), on_alarm="brake", solver=solver
    )
    env.reset(seed=0)
    quietly(env)
    fault[0] = int(reason)
    for step in range(400):
        report = quietly(env)
        assert report["status"] == FilterStatus.BACKUP
        assert comes.h(env.unwrapped.x, PERIOD * (step + 2)) >= 0.0
    assert np.linalg.norm(env.unwrapped.x[:2]) > 0.1, "it stood where the disc passed"


@pytest.mark.parametrize("on_alarm", ["warn", "brake"])
def test_an_alarm_lasts_until_the_reset(on_alarm):
    fault = [0]
    env = filtered(lambda x: Estimate(x, fault=fault[0]), on_alarm=on_alarm)
    env.reset(seed=0)
    for _ in range(10):
        quietly(env)
    fault[0] = int(Reason.SLIP)
    with pytest.warns(UserWarning, match="slide"):
        env.step(AHEAD)
    fault[0] = 0
    for _ in range(15):
        report = quietly(env)
        assert report["reason"] == Reason.SLIP
        assert (report["status"] == FilterStatus.BACKUP) == (on_alarm == "brake")
    if on_alarm == "brake":
        assert np.linalg.norm(env.unwrapped.x[2:]) <= 1e-9
    env.reset(seed=0)
    assert quietly(env)["reason"] == 0


def test_scenes_of_another_size_never_reach_compiled_code():
    sets = [barriers.BarrierSet([(DISC,)] * 2), barriers.BarrierSet([(DISC,)])]
    env = filtered(listed=lambda: sets[0])
    with pytest.warns(UserWarning, match="barriers"):
        env.reset(seed=0)
    assert quietly(env)["reason"] == Reason.BARRIERS
    sets[0] = sets[1]
    assert quietly(env)["reason"] == 0
    sets[0].priority[0, 0] = 1_000_000
    with pytest.raises(InvalidInputError, match="ranks"):
        env.step(AHEAD)
