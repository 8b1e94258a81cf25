"""Native batch, Gymnasium's batch of singles, and singles: one behaviour, infos included."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers.vector import NormalizeObservation, RecordEpisodeStatistics

from hcbf_gym import _core, policies, scenarios, wrappers
from hcbf_gym.barriers import BarrierSet, Capsule, ConvexPolygon, Disc, Ellipse, HalfPlane
from hcbf_gym.envs.task import CONTROL_DT, PHYSICS_DT, SUBSTEPS
from hcbf_gym.errors import InvalidInputError
from tests.pairs import pairwise
from tests.worlds import with_others

ID = "HCBF-Regions-v0"
N, LIMIT = 3, 90
MODES = list(AutoresetMode)
SCENES = ("random-moving", "paper-experiment")
TARN = f"{Path(__file__).parents[1] / 'scenarios' / 'tarn.py'}:tarn"
SEEN = f"{TARN}-seen"  # with its own observation, reward and costs
OTHERS = (
    TARN,
    SEEN,
    "map-flat",
    *(n for n in scenarios.families() if n not in SCENES and not n.startswith(("map-", "tarn"))),
)
STACKS = ("bare", "filter", "penalty", "held")
CASES = pairwise(
    (*SCENES, *OTHERS), STACKS, MODES,
    allowed=lambda scene, stack, _: (
        scene in SCENES or stack == "bare" or (scene, stack) == ("map-flat", "filter")
    ),
)  # fmt: skip
HELD = 4  # does not divide the limit


def single(scenario, stack="bare", limit=LIMIT, program="lex-cbf-qp"):
    env = gym.make(ID, scenario=scenario, max_episode_steps=limit)
    if stack != "bare":
        env = wrappers.SafetyFilter(env, program=program)
    if stack == "held":
        return wrappers.HoldAction(env, HELD)
    return wrappers.InterventionPenalty(env) if stack == "penalty" else env


def native(
    scenario,
    stack="bare",
    mode=AutoresetMode.NEXT_STEP,
    limit=LIMIT,
    n=N,
    program="lex-cbf-qp",
):
    inner = AutoresetMode.DISABLED if stack == "held" else mode
    env = gym.make_vec(
        ID, num_envs=n, scenario=scenario, autoreset_mode=inner, max_episode_steps=limit
    )
    if stack != "bare":
        env = wrappers.VectorSafetyFilter(env, program=program)
    if stack == "held":
        return wrappers.VectorHoldAction(env, HELD, mode)
    return wrappers.VectorInterventionPenalty(env) if stack == "penalty" else env


def sync(scenario, stack="bare", mode=AutoresetMode.NEXT_STEP, program="lex-cbf-qp"):
    one = lambda: single(scenario, stack, program=program)  # noqa: E731
    return SyncVectorEnv([one] * N, autoreset_mode=mode)


def assert_close(one, other, where, atol):
    np.testing.assert_allclose(
        one, other, atol=atol, rtol=0.0 if atol == 0.0 else 1e-7, err_msg=where
    )


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
                assert_close(mine, theirs, place, atol)


def row(infos, i):
    """The infos of environment i, as a single environment reports them."""
    return {
        key: row(value, i) if isinstance(value, dict) else value[i]
        for key, value in infos.items()
        if not key.startswith("_")
    }


def assert_equal_returns(ones, others, where, atol=1e-7):
    for mine, theirs in zip(ones[:-1], others[:-1], strict=True):
        assert mine.dtype == theirs.dtype, where
        assert_close(mine, theirs, where, atol)
    assert_equal(ones[-1], others[-1], where, atol)


@pytest.mark.parametrize(("scenario", "stack", "mode"), CASES)
def test_native_sync_and_single_agree_in_everything(scenario, stack, mode):
    batch, joined, alone = native(scenario, stack, mode), sync(scenario, stack, mode), []
    atol = 0.0 if stack == "bare" else 1e-7
    returns, expected = batch.reset(seed=7), joined.reset(seed=7)
    assert_equal_returns(returns, expected, "reset", atol)
    for i in range(N):
        alone.append(single(scenario, stack))
        observation, info = alone[i].reset(seed=7 + i)
        np.testing.assert_allclose(returns[0][i], observation, atol=1e-12)
        assert_equal(row(returns[1], i), info)
    policy, ended, episodes = policies.PDTracker.for_env(batch), np.zeros(N, dtype=bool), 0
    rng = np.random.default_rng(1)
    if scenario == SEEN:  # PD cannot read its observations
        policy = lambda observation, info: rng.uniform(-4.0, 4.0, (N, 2)).astype(np.float32)  # noqa: E731
    for k in range(2 * LIMIT + 5):
        if mode is AutoresetMode.DISABLED and ended.any():
            returns = batch.reset(options={"reset_mask": ended})
            again = joined.reset(options={"reset_mask": ended.copy()})
            assert_equal_returns(returns, again, f"reset at {k}", atol)
            ended = np.zeros(N, dtype=bool)
        u = policy(returns[0], returns[-1])
        returns, expected = batch.step(u), joined.step(u)
        assert_equal_returns(returns, expected, f"step {k}", atol)
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
        given = {"reset_mask": mask, **(options or {})}
        returns, expected = batch.reset(options=given), joined.reset(options=dict(given))
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
    def trajectory(seed):
        env = native("random", n=3)
        first, _ = env.reset(seed=seed)
        actions = np.random.default_rng(0).uniform(-5, 5, (LIMIT + 20, 3, 2))
        return np.array([first, *(env.step(u)[0] for u in actions)])

    np.testing.assert_array_equal(trajectory(5), trajectory(5))
    assert not np.allclose(trajectory(5), trajectory(6))
    assert len({float(first) for first in trajectory(5)[0, :, 0]}) == 3
    # environment i has the seed 5 + i
    np.testing.assert_array_equal(trajectory(5)[0, 1:], trajectory(6)[0, :-1])


def test_the_scenes_property_shows_each_robots_scene():
    env = native("random", n=5).unwrapped
    env.reset(seed=0)
    h, _ = env.barrier_set.sense(env.rom_state, env.time)
    for i, scene in enumerate(env.scenes):
        values = [barrier.h(env.rom_state[i], 0.0) for barrier in scene.barriers]
        np.testing.assert_allclose(h[i, : len(values)], values, atol=1e-9)


def test_an_intervention_is_charged_and_the_terms_still_sum_to_the_reward():
    env = wrappers.InterventionPenalty(single("random", "filter"), weight=0.1)
    assert isinstance(env.spec.make(), wrappers.InterventionPenalty)
    env.reset(seed=0)
    charged = 0.0
    for _ in range(LIMIT - 1):
        _, reward, _, _, info = env.step(np.full(2, 5.0))
        terms = sum(value for key, value in info.items() if key.startswith("reward_"))
        assert terms == pytest.approx(reward, abs=1e-12)
        penalty = -0.1 * info["safety_filter"]["intervention"]
        assert info["reward_intervention"] == pytest.approx(penalty)
        charged += info["reward_intervention"]
    assert charged < -0.1


def test_a_penalty_without_a_filter_is_refused():
    with pytest.raises(InvalidInputError, match="SafetyFilter"):
        wrappers.InterventionPenalty(single("random"))
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
    regions = with_others(
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
    least, before, on_way = np.empty((n, len(regions))), np.empty(n), x.copy()
    _core.regions_advance(*scene, still, x, steps, u, np.full(n, np.inf), least, before)
    expected = np.full(least.shape, np.inf)
    for k in range(1, SUBSTEPS + 1):
        after = on_way[:, 2:] + u * PHYSICS_DT
        on_way[:, :2] += 0.5 * (on_way[:, 2:] + after) * PHYSICS_DT
        on_way[:, 2:] = after
        now = CONTROL_DT * steps + k * PHYSICS_DT
        expected = np.minimum(expected, scenes.values(on_way, now))
    np.testing.assert_array_equal(least, expected)
