"""What Stable-Baselines3 sees of single environments and of the native batch."""

import gymnasium as gym
import numpy as np
import pytest
from needs import remedy

pytest.importorskip("stable_baselines3", reason=remedy("stable_baselines3"))

from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from hcbf_gym import wrappers
from hcbf_gym.wrappers.sb3 import Sb3VecEnv

ID = "HCBF-Regions-v0"


def single(limit):
    env = gym.make(ID, scenario="random", max_episode_steps=limit)
    env = wrappers.InterventionPenalty(wrappers.SafetyFilter(env, program="lex-cbf-qp"))
    return gym.wrappers.RescaleAction(env, np.float32(-1), np.float32(1))


def native(n=2, limit=1000):
    env = gym.make_vec(
        ID, num_envs=n, scenario="random", autoreset_mode="Disabled", max_episode_steps=limit
    )
    return wrappers.VectorInterventionPenalty(wrappers.VectorSafetyFilter(env, "lex-cbf-qp"))


class Head:
    """A policy that heads for the goal."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        u = 2.0 * observation[:, 0:2] + 3.0 * observation[:, 2:4]
        return np.clip(u / 5.0, -1.0, 1.0).astype(np.float32), state


def test_a_running_step_reports_what_a_single_environment_reports():
    joined, batch = DummyVecEnv([lambda: single(30)] * 2), Sb3VecEnv(native(limit=30))
    for env in (joined, batch):
        env.seed(5)
    observation, _ = batch.reset(), joined.reset()
    assert [set(info) for info in batch.reset_infos] == [set(info) for info in joined.reset_infos]
    for _ in range(29):
        action, _ = Head().predict(observation)
        observation, reward, done, infos = batch.step(action)
        _, gained, ended, others = joined.step(action)
        np.testing.assert_array_equal(done, ended)
        np.testing.assert_allclose(reward, gained, atol=1e-5)
        for info, other in zip(infos, others, strict=True):
            assert set(info) == set(other) - {"TimeLimit.truncated"}
            for key in ("cost", "reward_intervention", "is_success"):
                assert info[key] == pytest.approx(other[key], abs=1e-5)
            one, two = info["safety_filter"], other["safety_filter"]
            assert one["intervention"] == pytest.approx(two["intervention"], abs=1e-4)
    _, _, done, infos = batch.step(action)
    assert done.all()
    assert all(info["TimeLimit.truncated"] and info["episode"]["l"] == 30 for info in infos)


def test_attributes_are_found_through_filters():
    env = Sb3VecEnv(native(3))
    env.seed(0)
    env.reset()
    goals = [scene.goal for scene in env.get_attr("scenario")]
    assert len({tuple(goal) for goal in goals}) == 3
    np.testing.assert_array_equal(env.get_attr("scenario", [1])[0].goal, goals[1])
    assert env.get_attr("weight") == [0.01] * 3
    assert [x.shape for x in env.get_attr("rom_state")] == [(4,)] * 3


@pytest.mark.parametrize(
    "make",
    [
        lambda: VecMonitor(Sb3VecEnv(native(4)), info_keywords=("cost",)),
        lambda: DummyVecEnv([lambda: Monitor(single(1000))] * 2),
    ],
)
def test_evaluation_counts_successes(make):
    env, successes, reached = make(), [], []

    def note(local, _):
        if local["done"]:
            successes.append(local["info"]["is_success"])
            reached.append(local["info"]["reward_goal"] == 10.0)

    env.seed(3)
    evaluate_policy(Head(), env, n_eval_episodes=4, callback=note)
    np.testing.assert_array_equal(successes, np.float64(reached))
    assert len(reached) == 4
    assert any(reached)
