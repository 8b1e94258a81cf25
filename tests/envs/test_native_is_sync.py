"""Native batch, Gymnasium's batch of singles, and singles: one behaviour, infos included."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from hcbf_gym import policies, wrappers

ID = "HCBF-Regions-v0"
N, LIMIT = 3, 90
MODES = list(AutoresetMode)
STACKS = ("bare", "filter", "penalty", "held")
HELD = 4  # does not divide the limit


def single(scenario, stack="bare", limit=LIMIT):
    env = gym.make(ID, scenario=scenario, max_episode_steps=limit)
    if stack != "bare":
        env = wrappers.SafetyFilter(env, program="lex-cbf-qp")
    if stack == "held":
        return wrappers.HoldAction(env, HELD)
    return wrappers.InterventionPenalty(env) if stack == "penalty" else env


def native(scenario, stack="bare", mode=AutoresetMode.NEXT_STEP, limit=LIMIT, n=N):
    inner = AutoresetMode.DISABLED if stack == "held" else mode
    env = gym.make_vec(
        ID, num_envs=n, scenario=scenario, autoreset_mode=inner, max_episode_steps=limit
    )
    if stack != "bare":
        env = wrappers.VectorSafetyFilter(env, program="lex-cbf-qp")
    if stack == "held":
        return wrappers.VectorHoldAction(env, HELD, mode)
    return wrappers.VectorInterventionPenalty(env) if stack == "penalty" else env


def sync(scenario, stack="bare", mode=AutoresetMode.NEXT_STEP, limit=LIMIT):
    return SyncVectorEnv([lambda: single(scenario, stack, limit)] * N, autoreset_mode=mode)


def assert_equal(one, other, where="", atol=1e-7):
    """The same keys, types, shapes and values, in nested infos too."""
    assert set(one) == set(other), where
    for key, value in one.items():
        place = f"{where}/{key}"
        if isinstance(value, dict):
            assert_equal(value, other[key], place, atol)
            continue
        assert (value.dtype, value.shape) == (other[key].dtype, other[key].shape), place
        for mine, theirs in zip(np.atleast_1d(value), np.atleast_1d(other[key]), strict=True):
            assert (mine is None) == (theirs is None), place
            if mine is not None:
                np.testing.assert_allclose(mine, theirs, atol=atol, err_msg=place)


def row(infos, i):
    """The infos of environment i, as a single environment reports them."""
    return {
        key: row(value, i) if isinstance(value, dict) else value[i]
        for key, value in infos.items()
        if not key.startswith("_")
    }


def assert_equal_returns(ones, others, where):
    for mine, theirs in zip(ones[:-1], others[:-1], strict=True):
        assert mine.dtype == theirs.dtype, where
        np.testing.assert_allclose(mine, theirs, atol=1e-7, err_msg=where)
    assert_equal(ones[-1], others[-1], where)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("stack", STACKS)
@pytest.mark.parametrize("scenario", ["random-moving", "paper-experiment"])
def test_native_sync_and_single_agree_in_everything(scenario, stack, mode):
    batch, joined, alone = native(scenario, stack, mode), sync(scenario, stack, mode), []
    returns, expected = batch.reset(seed=7), joined.reset(seed=7)
    assert_equal_returns(returns, expected, "reset")
    for i in range(N):
        alone.append(single(scenario, stack))
        observation, info = alone[i].reset(seed=7 + i)
        np.testing.assert_allclose(returns[0][i], observation, atol=1e-12)
        assert_equal(row(returns[1], i), info)
    policy, ended, episodes = policies.PDTracker.for_env(batch), np.zeros(N, dtype=bool), 0
    for k in range(2 * LIMIT + 5):
        if mode is AutoresetMode.DISABLED and ended.any():
            returns = batch.reset(options={"reset_mask": ended})
            assert_equal_returns(returns, joined.reset(options={"reset_mask": ended.copy()}), k)
            ended = np.zeros(N, dtype=bool)
        u = policy(returns[0], returns[-1])
        returns, expected = batch.step(u), joined.step(u)
        assert_equal_returns(returns, expected, f"step {k}")
        if not (ended.any() or episodes):  # the first episodes, before anything restarts
            for i, env in enumerate(alone):
                observation, reward, terminated, truncated, info = env.step(u[i])
                done, infos = terminated or truncated, returns[-1]
                in_step = mode is AutoresetMode.SAME_STEP and done
                last = infos["final_obs"][i] if in_step else returns[0][i]
                np.testing.assert_allclose(last, observation, atol=1e-7)
                np.testing.assert_allclose(returns[1][i], reward, atol=1e-7)
                assert (returns[2][i], returns[3][i]) == (terminated, truncated)
                assert_equal(row(infos["final_info"] if in_step else infos, i), info)
        ended = returns[2] | returns[3]
        episodes += int(ended.sum())
    assert episodes >= N
    batch.close()
    joined.close()


@pytest.mark.parametrize("mode", MODES)
def test_a_reset_with_options_is_the_same_everywhere(mode):
    batch, joined = native("random", "filter", mode), sync("random", "filter", mode)
    batch.reset(seed=1)
    joined.reset(seed=1)
    for options in ({"start": [0.4, -0.3]}, {"scenario": "random-moving"}, None):
        mask = np.array([True, False, True])
        asked = {"reset_mask": mask, **(options or {})}
        returns, expected = batch.reset(options=asked), joined.reset(options=dict(asked))
        np.testing.assert_allclose(returns[0][mask], expected[0][mask], atol=1e-9)
        assert_equal(returns[1], expected[1])
        assert [s.name for s in batch.unwrapped.scenes] == [
            s.name for s in joined.get_attr("scenario")
        ]
        for _ in range(LIMIT + 3 if mode is not AutoresetMode.DISABLED else 5):
            u = np.full((N, 2), 0.3)
            assert_equal_returns(batch.step(u), joined.step(u), "step")


def test_a_goal_reached_at_the_time_limit_ends_the_episode_twice():
    env = single("random", limit=-1)
    policy = policies.PDTracker.for_env(env)
    observation, info = env.reset(seed=2)
    steps, terminated = 0, False
    while not terminated:
        observation, _, terminated, truncated, info = env.step(policy(observation, info))
        steps += 1
        assert not truncated
    assert info["is_success"] == 1.0
    batch, joined = native("random", limit=steps, n=1), single("random", limit=steps)
    (observation, info), _ = batch.reset(seed=2), joined.reset(seed=2)
    for _ in range(steps):
        u = policy(observation, info)
        observation, _, terminated, truncated, info = batch.step(u)
        *_, ended, cut, _ = joined.step(u[0])
    assert bool(terminated[0]) is bool(truncated[0]) is ended is cut is True


def test_without_a_limit_nothing_is_truncated():
    batch = native("paper-experiment", limit=-1)
    batch.reset(seed=0)
    for _ in range(1100):
        *_, truncated, info = batch.step(np.zeros((N, 2)))
        assert not truncated.any()
    assert set(info) >= {"h", "_h"}


@pytest.mark.parametrize("mode", MODES)
def test_a_reset_is_never_charged(mode):
    batch = native("random", "penalty", mode, limit=20)
    batch.reset(seed=0)
    ended, resets, charged = np.zeros(N, dtype=bool), 0, 0.0
    for _ in range(90):
        if mode is AutoresetMode.DISABLED and ended.any():
            batch.reset(options={"reset_mask": ended})
        restarted = ended if mode is AutoresetMode.NEXT_STEP else np.zeros(N, dtype=bool)
        _, reward, terminated, truncated, info = batch.step(np.full((N, 2), 5.0))
        ended = terminated | truncated
        resets += int(restarted.sum())
        np.testing.assert_array_equal(reward[restarted], 0.0)
        if mode is AutoresetMode.SAME_STEP and ended.any():
            resets += int(ended.sum())
            np.testing.assert_array_equal(info["reward_intervention"][ended], 0.0)
            charged += info["final_info"]["reward_intervention"].sum()
            info = info["final_info"]
        parts = sum(value for key, value in info.items() if key.startswith("reward_"))
        shown = info["_reward_intervention"]
        np.testing.assert_allclose(parts[shown], reward[shown], atol=1e-12)
        charged += info["reward_intervention"].sum()
    assert charged < 0.0
    assert resets > 0 or mode is AutoresetMode.DISABLED


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("vector", [False, True])
def test_a_copy_in_mid_episode_goes_on_identically(vector, duplicate):
    env = native("random", "penalty") if vector else single("random", "penalty")
    u = np.full((N, 2) if vector else 2, 1.5)
    env.reset(seed=4)
    for _ in range(30):
        env.step(u)
    other = duplicate(env)
    for _ in range(LIMIT if vector else 50):  # past an autoreset, which draws a scene
        one, two = env.step(u), other.step(u)
        np.testing.assert_array_equal(one[0], two[0])
        np.testing.assert_array_equal(one[1], two[1])
        assert_equal(one[-1], two[-1], atol=0.0)
