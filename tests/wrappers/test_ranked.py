"""Costs by rank, and observations with ranks, in every random scene alike."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

from hcbf_gym import wrappers
from hcbf_gym.barriers import BarrierSet, Disc, SpeedLimit
from hcbf_gym.envs import task
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.scenarios import families
from hcbf_gym.wrappers import (
    HoldAction,
    RankedObservation,
    SafetyFilter,
    VectorRankedObservation,
    VectorSafetyFilter,
)

ROM = "HCBF-Regions-v0"


def scene(*discs):
    barriers = [
        {"kind": "disc", "name": f"d{k}", "priority": rank, "center": center, "radius": 1.0}
        for k, (rank, center) in enumerate(discs)
    ]
    return {
        "name": "discs", "barriers": barriers, "reference": {"kind": "point", "goal": (9, 0)},
        "task": "reach",
    }  # fmt: skip


def test_costs_are_depths_by_rank_and_the_cost_is_rank_one_alone():
    env = gym.make(ROM, scenario=scene((1, (5, 0)), (2, (0.5, 0)), (3, (0.2, 0)), (3, (0.9, 0))))
    _, info = env.reset(seed=0)
    np.testing.assert_allclose(info["costs"], [0.0, 0.5, 0.8])
    assert info["cost"] == 0.0
    _, _, _, _, info = env.step(np.zeros(2))
    np.testing.assert_allclose(info["costs"], [0.0, 0.5, 0.8])
    env = gym.make(ROM, scenario=scene((1, (0.4, 0)), (2, (5, 0))))
    _, info = env.reset(seed=0)
    np.testing.assert_allclose(info["costs"], [0.6, 0.0])
    assert info["cost"] == 1.0


def test_a_speed_above_its_limit_costs_and_has_no_metres():
    disc, limit = Disc("disc", 2, center=(9.0, 0.0), radius=1.0), SpeedLimit("speed", 1, 0.5)
    scenes = BarrierSet([(disc, limit)] * 2)
    cost, costs = task.costs_of(np.array([[0.1, -0.2], [-0.3, 0.1]]), scenes, 2)
    np.testing.assert_array_equal(cost, [1.0, 0.0])
    np.testing.assert_array_equal(costs, [[0.0, 0.0], [0.0, 0.3]])


def test_an_episode_costs_something_exactly_if_it_enters_rank_one():
    paid = set()
    for filtered in (False, True):
        env = gym.make(ROM, scenario="random")
        env = SafetyFilter(env, "lex-cbf-qp") if filtered else env
        for seed in range(6):
            observation, info = env.reset(seed=seed)
            ranks = np.array([b.priority for b in env.unwrapped.barriers])
            assert info["costs"].shape == (3,)
            for _ in range(150):
                u = 2.0 * observation[:2] + 3.0 * observation[2:4]
                observation, _, terminated, truncated, info = env.step(u)
                assert info["cost"] == (info["min_h"][ranks == 1] < 0.0).any()
                paid.add((filtered, bool(info["cost"])))
                if terminated or truncated:
                    break
    assert paid == {(False, False), (False, True), (True, False)}


def test_a_held_decision_costs_what_its_steps_do():
    one = gym.make(ROM, scenario=scene((1, (0.4, 0)), (2, (0.5, 0))))
    held = HoldAction(gym.make(ROM, scenario=scene((1, (0.4, 0)), (2, (0.5, 0)))), 3)
    one.reset(seed=0)
    held.reset(seed=0)
    infos = [one.step(np.array([1.0, 0.0]))[-1] for _ in range(3)]
    info = held.step(np.array([1.0, 0.0]))[-1]
    assert info["cost"] == 3.0
    np.testing.assert_allclose(info["costs"], sum(step["costs"] for step in infos))


@pytest.mark.parametrize("family", sorted(families()))
def test_observations_of_all_random_scenes_have_one_length_and_the_ranks(family):
    env = RankedObservation(gym.make(ROM, scenario=family))
    observation, info = env.reset(seed=3)
    assert observation.shape == env.observation_space.shape == (8 + 6 * 27,)
    slots = observation[8:].reshape(27, 6)
    present, rank, near = slots[:, 0] == 1.0, slots[:, 1].astype(int), slots[:, 2]
    inner = env.unwrapped
    count = len(inner.scenario.conditions)
    h, ranks = info["h"][:count], np.array([b.priority for b in inner.scenario.conditions])
    assert present.sum() == (h < 5.0).sum() > 0
    assert sorted(zip(near[present].round(9), rank[present], strict=True)) == sorted(
        zip(np.maximum(h[h < 5.0] / 5.0, -1.0).round(9), ranks[h < 5.0], strict=True)
    )
    assert (np.diff(near[present]) >= 0.0).all()
    assert not slots[~present].any()


def test_a_batch_is_ranked_as_its_single_environments():
    batch = gym.make_vec(ROM, num_envs=3, scenario="random-clutter", autoreset_mode="Disabled")
    batch = VectorRankedObservation(VectorSafetyFilter(batch))
    many, _ = batch.reset(seed=5)
    for i in range(3):
        env = RankedObservation(SafetyFilter(gym.make(ROM, scenario="random-clutter")))
        one, _ = env.reset(seed=5 + i)
        np.testing.assert_allclose(many[i], one, atol=1e-12)
    assert batch.observation_space.contains(many)


def test_other_environments_and_sizes_are_refused():
    with pytest.raises(InvalidInputError, match="of this package"):
        RankedObservation(gym.make("Pendulum-v1"))
    with pytest.raises(InvalidInputError, match="slots"):
        RankedObservation(gym.make(ROM), slots=0)


ID = "HCBF-Regions-v0"


def filtered(limit=57):
    env = gym.make(ID, scenario="random", max_episode_steps=limit)
    return wrappers.SafetyFilter(env, program="lex-cbf-qp")


def test_a_held_decision_is_the_sum_and_the_worst_of_its_steps():
    held, plain = wrappers.HoldAction(filtered(), 5), filtered()
    held.reset(seed=3)
    plain.reset(seed=3)
    lengths = []
    for u in np.random.default_rng(0).uniform(-5, 5, (20, 2)):
        observation, reward, terminated, truncated, info = held.step(u)
        infos, rewards, ended = [], [], False
        while len(infos) < 5 and not ended:
            expected, gained, *ends, step = plain.step(u)
            infos.append(step)
            rewards.append(gained)
            ended = any(ends)
        lengths.append(len(infos))
        np.testing.assert_array_equal(observation, expected)
        assert reward == pytest.approx(sum(rewards))
        assert info["cost"] == pytest.approx(sum(step["cost"] for step in infos))
        assert info["reward_effort"] == pytest.approx(sum(s["reward_effort"] for s in infos))
        np.testing.assert_array_equal(info["min_h"], np.min([s["min_h"] for s in infos], axis=0))
        np.testing.assert_array_equal(info["h"], infos[-1]["h"])
        reports, report = [s["safety_filter"] for s in infos], info["safety_filter"]
        assert report["status"] == max(r["status"] for r in reports)
        np.testing.assert_allclose(report["u_safe"], np.mean([r["u_safe"] for r in reports], 0))
        assert report["intervention"] == pytest.approx(
            np.mean([r["intervention"] for r in reports])
        )
        if ended:
            break
    assert (terminated, truncated) == (False, True)
    assert lengths == [5] * 11 + [2]  # 57 steps


def test_it_is_rebuilt_from_its_spec():
    env = wrappers.HoldAction(filtered(), 5)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert again.get_wrapper_attr("steps") == 5
    assert again.spec == env.spec


@pytest.mark.parametrize("steps", [0, -1, 2.5, True, "5"])
def test_a_hold_that_cannot_be_is_refused(steps):
    with pytest.raises(InvalidInputError, match="whole number"):
        wrappers.HoldAction(filtered(), steps)


def test_the_vector_form_names_where_it_belongs():
    with pytest.raises(InvalidInputError, match="Disabled"):
        wrappers.VectorHoldAction(gym.make_vec(ID, num_envs=2), 5)
    with pytest.raises(InvalidInputError, match="before they are joined"):
        wrappers.VectorHoldAction(SyncVectorEnv([filtered]), 5)
