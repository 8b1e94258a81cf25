"""What signals show of a plant that is another one, and what the filter does after an alarm."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from point_mass import AHEAD, DISC, PERIOD, filtered, quietly

from hcbf_gym import barriers, wrappers
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.plant import Estimate, Reason
from hcbf_gym.programs import FilterStatus


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


def test_the_users_brake_is_asked_with_a_state_that_is_known_and_may_change_its_copy():
    asked = []

    def brake(x):
        asked.append(x.copy())
        x[:] = np.nan
        return np.array([-1.0, 0.0])

    reported = [None]
    env = filtered(lambda x: reported[0], brake=brake, on_alarm="brake")
    with pytest.warns(UserWarning, match="not finite"):
        env.reset(seed=0)
    np.testing.assert_array_equal(quietly(env)["u_safe"], [0.0, 0.0])
    assert not asked
    reported[0] = Estimate(np.array([0.0, 0.0, 0.5, 0.0]), time=1.0, fault=int(Reason.SLIP))
    report = quietly(env)
    np.testing.assert_array_equal(report["u_safe"], [-1.0, 0.0])
    np.testing.assert_array_equal(asked, [reported[0].x])
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


SENSORS = {
    "frozen": lambda: lambda x: np.array([0.3, 0.1, *x[2:]]),
    "swapped": lambda: lambda x: np.array([x[1], x[0], *x[2:]]),
    "half": lambda: lambda x: np.array([0.5 * x[0], 0.5 * x[1], *x[2:]]),
    "twice": lambda: lambda x: np.array([2.0 * x[0], 2.0 * x[1], *x[2:]]),
    "a fifth more": lambda: lambda x: np.array([1.2 * x[0], 1.2 * x[1], *x[2:]]),
    "velocity of another": lambda: lambda x: np.array([*x[:2], 0.0, 0.0]),
}


def late(steps):
    waiting = [np.zeros(2)] * steps

    def reported(x):
        waiting.append(x[:2].copy())
        return np.array([*waiting.pop(0), *x[2:]])

    return reported


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
def test_a_position_that_does_not_move_as_the_velocity_does_is_noticed(sensor):
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


def test_scenes_of_another_size_never_reach_compiled_code():
    sets = [barriers.BarrierSet([(DISC,)] * count, is_placed=True) for count in (2, 1)]
    env = filtered(listed=lambda: sets[0])
    with pytest.warns(UserWarning, match="barriers"):
        env.reset(seed=0)
    assert quietly(env)["reason"] == Reason.BARRIERS
    sets[0] = sets[1]
    assert quietly(env)["reason"] == 0
    sets[0].priority[0, 0] = 1_000_000
    sets[0].changed(0)
    with pytest.raises(InvalidInputError, match="ranks"):
        env.step(AHEAD)


@pytest.mark.parametrize("name", ["HCBF-Regions-v0", "HCBF-A1Regions-v0"])
def test_this_packages_environments_raise_no_alarm_with_a_solver_by_name(name):
    env = gym.make(name, scenario="random")
    env = wrappers.SafetyFilter(env, "lex-cbf-qp", solver="daqp")
    for seed in range(2):
        _, info = env.reset(seed=seed)
        for k in range(150):
            action = 2.0 * np.array([np.cos(0.05 * k), np.sin(0.08 * k)])
            *_, over, _, info = env.step(action.astype(np.float32))
            assert info["safety_filter"]["reason"] == 0
            if over:
                break
