"""A fleet is Gymnasium's batch of singles, infos included, whatever the processes."""

import os
import signal

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from hcbf_gym import wrappers
from hcbf_gym.envs.fleet import FleetVectorEnv
from hcbf_gym.errors import HcbfError, InvalidInputError

N, LIMIT = 3, 12
pytestmark = pytest.mark.filterwarnings("ignore::hcbf_gym.errors.CoverageWarning")


def cart():
    env = gym.make(
        "HCBF-WalkerRegions-v0", robot="cart", scenario="random", max_episode_steps=LIMIT
    )
    return wrappers.SafetyFilter(env)


def point():
    return wrappers.SafetyFilter(gym.make("HCBF-Regions-v0", max_episode_steps=LIMIT))


def assert_same(one, other, where=""):
    """The same keys, types, shapes and numbers, bit for bit."""
    if isinstance(one, dict):
        assert set(one) == set(other), where
        for key in one:
            assert_same(one[key], other[key], f"{where}/{key}")
        return
    assert (one.dtype, one.shape) == (other.dtype, other.shape), where
    np.testing.assert_equal(list(one), list(other), err_msg=where)


def assert_all_same(ones, others, where):
    for mine, theirs in zip(ones, others, strict=True):
        assert_same(mine, theirs, where)


@pytest.fixture
def pair(request):
    mode, processes, make = request.param
    fleet = FleetVectorEnv([make] * N, processes, mode)
    sync = SyncVectorEnv([make] * N, autoreset_mode=mode)
    yield fleet, sync
    fleet.close()
    sync.close()


def pairs(*processes, make=cart, modes=tuple(AutoresetMode)):
    cases = [(mode, count, make) for mode in modes for count in processes]
    names = [f"{mode.value}-{count}" for mode, count, _ in cases]
    return pytest.mark.parametrize("pair", cases, indirect=True, ids=names)


@pairs(1, 2)
def test_a_fleet_is_sync_in_everything(pair):
    fleet, sync = pair
    rng, ended = np.random.default_rng(3), np.zeros(N, dtype=bool)
    assert_all_same(fleet.reset(seed=7), sync.reset(seed=7), "reset")
    for k in range(2 * LIMIT + 5):
        if fleet.autoreset_mode is AutoresetMode.DISABLED and ended.any():
            asked = {"reset_mask": ended, "start": [0.4, -0.3]}
            assert_all_same(
                fleet.reset(options=asked), sync.reset(options=dict(asked)), f"reset {k}"
            )
        u = rng.uniform(-5.0, 5.0, (N, 2))
        seen = fleet.step(u)
        assert_all_same(seen, sync.step(u), f"step {k}")
        ended = seen[2] | seen[3]
    assert [s.name for s in fleet.get_attr("scenario")] == [
        s.name for s in sync.get_attr("scenario")
    ]


@pairs(2, make=point, modes=(AutoresetMode.NEXT_STEP,))
def test_what_an_environment_refuses_is_refused_wherever_it_is(pair):
    fleet, sync = pair
    fleet.reset(seed=1)
    sync.reset(seed=1)
    for bad in (np.zeros((N, 3)), np.full((N, 2), "a"), np.array([[0, 0], [0, 0], [0, np.nan]])):
        with pytest.raises(InvalidInputError, match="action"):
            fleet.step(bad)
    assert_all_same(fleet.reset(seed=2), sync.reset(seed=2), "after errors")
    for options in ({"reset_mask": np.zeros(N, dtype=bool)}, {"reset_mask": [1, 1, 1]}):
        with pytest.raises(InvalidInputError, match="reset_mask"):
            fleet.reset(options=options)
    with pytest.raises(InvalidInputError, match="seeds"):
        fleet.reset(seed=[1, 2])


def test_a_process_that_dies_is_named():
    fleet = FleetVectorEnv([point] * 2, processes=2)
    fleet.reset(seed=0)
    (process,) = fleet._processes
    os.kill(process.pid, signal.SIGKILL)
    process.join()
    with pytest.raises(HcbfError, match="process 1 died"):
        fleet.step(np.zeros((2, 2)))
    fleet.close()


def test_closing_ends_the_processes():
    fleet = FleetVectorEnv([point] * 2, processes=2)
    fleet.close()
    assert not fleet._processes[0].is_alive()


class Told(gym.Wrapper):
    """Says a word in its infos, or another entry at every step."""

    def __init__(self, env, word):
        super().__init__(env)
        self.word = word

    def reset(self, **kwargs):
        observation, info = self.env.reset(**kwargs)
        return observation, info | ({"said": "word"} if self.word else {})

    def step(self, action):
        *rest, info = self.env.step(action)
        return *rest, info | {"said": 1.0}


def test_infos_that_no_memory_can_hold_are_refused():
    with pytest.raises(InvalidInputError, match=r"\['said'\]: got 'word'"):
        FleetVectorEnv([lambda: Told(point(), True)], processes=1)
    fleet = FleetVectorEnv([lambda: Told(point(), False)], processes=1)
    fleet.reset(seed=0)
    with pytest.raises(InvalidInputError, match="'said'"):
        fleet.step(np.zeros((1, 2)))
    fleet.close()


@pytest.mark.parametrize(("count", "processes"), [(0, 1), (2, 3), (2, 0)])
def test_a_fleet_without_members_or_with_idle_processes_is_refused(count, processes):
    with pytest.raises(InvalidInputError, match="processes"):
        FleetVectorEnv([point] * count, processes)
