"""The native vector environment against Gymnasium's own one of single environments."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers.vector import NormalizeObservation, RecordEpisodeStatistics

from hcbf_gym import _core, policies, programs, scenarios, wrappers
from hcbf_gym.barriers import Capsule, ConvexPolygon, Disc, Ellipse, HalfPlane
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.task import CONTROL_DT, PHYSICS_DT, SUBSTEPS
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models.reduced_order import double_integrator_step

ID = "HCBF-Regions-v0"
LIMIT = 120  # steps after which an episode is cut, so that several fit into a test
MODES = list(AutoresetMode)
SCENES = (
    "paper-experiment",
    "map-flat",
    *(name for name in scenarios.families() if not name.startswith("map-")),
)


def native(scenario, mode=AutoresetMode.NEXT_STEP, n=3, limit=LIMIT):
    return gym.make_vec(
        ID, num_envs=n, scenario=scenario, autoreset_mode=mode, max_episode_steps=limit
    )


def singles(scenario, mode=AutoresetMode.NEXT_STEP, n=3, program=None):
    def make():
        env = gym.make(ID, scenario=scenario, max_episode_steps=LIMIT)
        return env if program is None else wrappers.SafetyFilter(env, program=program)

    return SyncVectorEnv([make] * n, autoreset_mode=mode)


def assert_same(one, other, atol=1e-9):
    """The same nested infos: keys, types, values."""
    assert set(one) == set(other)
    for key, value in one.items():
        if isinstance(value, dict):
            assert_same(value, other[key], atol)
        elif value.dtype == object:  # the last observations of those that ended
            for i, last in enumerate(value):
                if last is not None:
                    np.testing.assert_allclose(last, other[key][i], atol=atol)
        else:
            assert value.dtype == other[key].dtype, key
            np.testing.assert_allclose(value, other[key], atol=atol, err_msg=key)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("scenario", SCENES)
def test_it_walks_as_single_environments_do_in_every_autoreset_mode(scenario, mode):
    batch, single = native(scenario, mode), singles(scenario, mode)
    policy = policies.PDTracker.for_env(batch)
    observation, info = batch.reset(seed=7)
    expected, expected_info = single.reset(seed=7)
    np.testing.assert_allclose(observation, expected, atol=1e-9)
    assert_same(info, expected_info)
    ended = np.zeros(3, dtype=np.bool_)
    for _ in range(2 * LIMIT + 10):
        if mode is AutoresetMode.DISABLED and ended.any():
            observation, info = batch.reset(options={"reset_mask": ended})
            expected, expected_info = single.reset(options={"reset_mask": ended})
            np.testing.assert_allclose(observation, expected, atol=1e-9)
        u = policy(observation, info)
        results, expectations = batch.step(u), single.step(u)
        for result, expectation in zip(results[:4], expectations[:4], strict=True):
            assert result.dtype == expectation.dtype
            np.testing.assert_allclose(result, expectation, atol=1e-9)
        ended = results[2] | results[3]
        if mode is not AutoresetMode.SAME_STEP or not ended.any():
            assert_same(common(results[4], expectations[4]), common(expectations[4], results[4]))
        else:
            for i in np.flatnonzero(ended):
                np.testing.assert_allclose(
                    results[4]["final_obs"][i], expectations[4]["final_obs"][i], atol=1e-9
                )
        observation = results[0]
    batch.close()
    single.close()


def common(info, other):
    """What both report: at a reset, single environments leave out what a step alone has."""
    return {key: value for key, value in info.items() if key in other and not key.startswith("_")}


@pytest.mark.parametrize("program", programs.names())
def test_its_filter_decides_as_the_single_one_does(program):
    scenario = "random" if program != "cbf-qp" else "paper-experiment"
    batch = wrappers.VectorSafetyFilter(native(scenario), program=program)
    single = singles(scenario, program=program)
    policy = policies.PDTracker.for_env(batch)
    observation, info = batch.reset(seed=3)
    expected, _ = single.reset(seed=3)
    for _ in range(LIMIT - 1):
        u = policy(observation, info)
        observation, reward, *_, info = batch.step(u)
        expected, expected_reward, *_, expected_info = single.step(u)
        np.testing.assert_allclose(observation, expected, atol=1e-9)
        np.testing.assert_allclose(reward, expected_reward, atol=1e-9)
        one, other = info["safety_filter"], expected_info["safety_filter"]
        np.testing.assert_allclose(one["u_safe"], other["u_safe"], atol=1e-7)
    batch.close()
    single.close()


def test_gymnasiums_spaces_and_wrappers_take_it():
    env = native("random", n=4)
    assert env.observation_space == batch_space(env.single_observation_space, 4)
    assert env.action_space == batch_space(env.single_action_space, 4)
    wrapped = NormalizeObservation(RecordEpisodeStatistics(env))
    env.action_space.seed(0)
    observation, _ = wrapped.reset(seed=0)
    assert env.observation_space.contains(observation)
    episodes = 0
    for _ in range(LIMIT + 1):
        observation, reward, terminated, truncated, _ = wrapped.step(env.action_space.sample())
        assert reward.shape == terminated.shape == truncated.shape == (4,)
        episodes += int((terminated | truncated).sum())
    assert episodes >= 4
    assert np.isfinite(observation).all()
    wrapped.close()
    wrapped.close()


def test_the_same_seed_gives_the_same_batch_and_each_its_own_scene():
    def run(seed):
        env = native("random", n=3)
        first, _ = env.reset(seed=seed)
        actions = np.random.default_rng(0).uniform(-5, 5, (LIMIT + 20, 3, 2))
        return np.array([first, *(env.step(u)[0] for u in actions)])

    np.testing.assert_array_equal(run(5), run(5))
    assert not np.allclose(run(5), run(6))
    assert len({float(first) for first in run(5)[0, :, 0]}) == 3
    np.testing.assert_array_equal(run(5)[0, 1:], run(6)[0, :-1])  # seed, seed + 1, …


def test_the_scenes_property_shows_what_each_robot_walks_in():
    env = native("random", n=5).unwrapped
    env.reset(seed=0)
    h, _ = env.barrier_set.sense(env.rom_state, env.time)
    for i, scene in enumerate(env.scenes):
        values = [barrier.h(env.rom_state[i], 0.0) for barrier in scene.barriers]
        np.testing.assert_allclose(h[i, : len(values)], values, atol=1e-9)


@pytest.mark.parametrize("vector", [False, True])
def test_an_intervention_is_charged_and_the_terms_still_sum_to_the_reward(vector):
    if vector:
        inner = wrappers.VectorSafetyFilter(native("random", n=2), "lex-cbf-qp")
        env = wrappers.VectorInterventionPenalty(inner, weight=0.1)
        u = np.full((2, 2), 5.0)
    else:
        inner = wrappers.SafetyFilter(gym.make(ID, scenario="random"), "lex-cbf-qp")
        env = wrappers.InterventionPenalty(inner, weight=0.1)
        assert env.spec is not None
        assert isinstance(env.spec.make(), wrappers.InterventionPenalty)
        u = np.full(2, 5.0)
    env.reset(seed=0)
    charged = 0.0
    for _ in range(100):
        _, reward, _, _, info = env.step(u)
        terms = [v for key, v in info.items() if key.startswith("reward_")]
        np.testing.assert_allclose(np.sum(terms, axis=0), reward, atol=1e-12)
        np.testing.assert_allclose(
            info["reward_intervention"], -0.1 * np.asarray(info["safety_filter"]["intervention"])
        )
        charged += np.sum(info["reward_intervention"])
    assert charged < -0.1


def test_a_penalty_without_a_filter_is_refused():
    with pytest.raises(InvalidInputError, match="SafetyFilter"):
        wrappers.InterventionPenalty(gym.make(ID))
    with pytest.raises(InvalidInputError, match="VectorSafetyFilter"):
        wrappers.VectorInterventionPenalty(native("random"))


@pytest.mark.parametrize(
    "wrong", [{"n": 0}, {"limit": 0}, {"mode": "Sometimes"}], ids=["n", "limit", "mode"]
)
def test_a_batch_that_cannot_be_is_refused(wrong):
    with pytest.raises(InvalidInputError, match="expected"):
        native("random", **wrong)


def test_the_least_h_on_the_way_is_that_of_its_ten_points():
    rng, n = np.random.default_rng(0), 2000
    corners = np.array([(0.0, 0.0), (1.2, 0.1), (0.9, 0.8), (0.1, 0.6)])
    regions = (
        HalfPlane("wall", 1, normal=(1.0, 0.0), offset=0.3),
        Disc("disc", 1, center=(0.3, -0.2), radius=0.5, velocity=(0.7, -0.4)),
        Ellipse("ellipse", 1, center=(0.1, 0.3), semi_axes=(1.1, 0.2), angle=0.7),
        ConvexPolygon("polygon", 1, vertices=corners, velocity=(-0.6, 0.2)),
        Capsule("capsule", 1, start=(-0.5, 0.0), end=(0.4, 0.5), radius=0.1),
    )
    scenes = BarrierSet([regions] * n, is_placed=True)
    speeds = 10.0 ** rng.uniform(-9.0, 1.0, (n, 1)) * (rng.random((n, 1)) < 0.95)
    x = np.hstack([rng.uniform(-1.5, 1.5, (n, 2)), rng.uniform(-1.0, 1.0, (n, 2)) * speeds])
    x[:50, :2] = regions[1].center  # where a region has no normal
    u, steps = rng.uniform(-5.0, 5.0, (n, 2)) * np.minimum(speeds, 1.0), rng.integers(0, 50, n)
    scene = scenes.kind, scenes.parameters, scenes.atlas.numbers
    still = np.zeros((1, 1, 6)), np.zeros(n, np.int64), np.zeros(n, np.int64)
    least, before, on_way = np.empty((n, 5)), np.empty(n), x.copy()
    _core.regions_advance(*scene, still, x, steps, u, np.full(n, np.inf), least, before)
    expected = np.full((n, 5), np.inf)
    for k in range(1, SUBSTEPS + 1):
        for i in range(n):
            on_way[i] = double_integrator_step(on_way[i], u[i], PHYSICS_DT, np.inf)
        now = CONTROL_DT * steps + k * PHYSICS_DT
        expected = np.minimum(expected, scenes.values(on_way, now))
    np.testing.assert_array_equal(least, expected)
