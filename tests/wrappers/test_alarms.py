"""What signals show of a plant that is another one, and what the filter does after an alarm."""

import gymnasium as gym
import numpy as np
import pytest
from point_mass import AHEAD, DISC, PERIOD, filtered, quietly

from hcbf_gym import Estimate, barriers, wrappers
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models import Reason
from hcbf_gym.programs import FilterStatus
from tests.worlds import OwnDisc

DOUBTS = Reason.MOTION, Reason.RESPONSE  # of the position
FAULTS = [one for one in Reason if one.lasts and one not in DOUBTS]


def test_an_action_that_is_refused_is_no_step():
    env = filtered(
        lambda x: Estimate(x, time=env.unwrapped.clock), listed=(OwnDisc("own", 1, (0.0, 9.0)),)
    )
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


@pytest.mark.parametrize("solver", [None, "daqp"])
@pytest.mark.parametrize("reason", FAULTS)
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
