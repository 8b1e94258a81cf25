"""Both environments, bare and filtered, as users of Gymnasium and SB3 expect them."""

import copy
import functools
import pickle
import warnings
from dataclasses import replace
from itertools import islice

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from needs import needs

import hcbf_gym
from hcbf_gym import policies, programs, scenarios, wrappers
from hcbf_gym.envs.a1_regions import A1RegionsEnv
from hcbf_gym.errors import HcbfError, InvalidInputError, RenderingError, UnknownNameError
from hcbf_gym.evaluation.episode import samples
from hcbf_gym.programs import FilterStatus

ENV_IDS = ("HCBF-Regions-v0", "HCBF-A1Regions-v0")
SHORT_SCENES = ("paper-simulation", "paper-experiment")

# Accelerations are in SI units and observations are unbounded, both on purpose.
ABOUT_SPACES = (
    "minimum value",
    "maximum value",
    "symmetric and normalized",
)


def filtered(env_id, program="h-cbf-qp", **kwargs):
    return wrappers.SafetyFilter(gym.make(env_id, **kwargs), program=program)


def run(env, steps, seed=0):
    walk = islice(samples(env, policies.PDTracker.for_env(env), seed), steps + 1)
    return [(sample.observation, sample.reward, sample.info) for sample in walk]


def flat(info):
    for key, value in sorted(info.items()):
        yield from flat(value) if isinstance(value, dict) else [(key, value)]


@pytest.mark.usefixtures("released")
@pytest.mark.parametrize("env_id", ENV_IDS)
@pytest.mark.parametrize("make", [gym.make, filtered], ids=["bare", "filtered"])
def test_gymnasiums_checker_has_nothing_to_say(env_id, make):
    env = make(env_id)
    inner = env if make is filtered else env.unwrapped
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(inner, skip_render_check=True)
    others = [str(w.message) for w in caught if not any(s in str(w.message) for s in ABOUT_SPACES)]
    others = [text for text in others if "different from the unwrapped version" not in text]
    assert others == []
    env.close()


@needs("stable_baselines3")
@pytest.mark.parametrize("env_id", ENV_IDS)
@pytest.mark.parametrize("make", [gym.make, filtered], ids=["bare", "filtered"])
def test_sb3s_checker_has_nothing_to_say(env_id, make):
    from stable_baselines3.common import env_checker as sb3_env_checker

    env = make(env_id)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        sb3_env_checker.check_env(env)
    others = [str(w.message) for w in caught if not any(s in str(w.message) for s in ABOUT_SPACES)]
    assert others == []
    env.close()


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_a_filtered_environment_is_rebuilt_from_its_spec(env_id):
    env = wrappers.SafetyFilter(
        gym.make(env_id, scenario="paper-experiment"),
        program="h-cbf-qp",
        gamma0=2.0,
        alpha1={"kind": "log", "phi1": 0.8},
        margin=0.05,
    )
    assert env.spec is not None
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    direct = env.spec.make()
    for rebuilt in (again, direct):
        assert "SafetyFilter" in str(rebuilt)
        for one, other in zip(run(env, 5), run(rebuilt, 5), strict=True):
            np.testing.assert_array_equal(one[0], other[0])
        rebuilt.close()
    env.close()


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_two_runs_of_one_seed_are_identical(env_id):
    first, second = (run(filtered(env_id), 60, seed=3) for _ in range(2))
    for (o1, r1, i1), (o2, r2, i2) in zip(first, second, strict=True):
        np.testing.assert_array_equal(o1, o2)
        assert r1 == r2
        for (k1, v1), (k2, v2) in zip(flat(i1), flat(i2), strict=True):
            assert k1 == k2
            np.testing.assert_array_equal(v1, v2)


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_of_the_a1_walks_alike_or_is_refused(duplicate):
    env = filtered("HCBF-A1Regions-v0", scenario="random")
    other = duplicate(env)
    assert other.unwrapped.spec == env.unwrapped.spec
    for (first, _, _), (second, _, _) in zip(run(env, 4), run(other, 4), strict=True):
        np.testing.assert_array_equal(first, second)
    for part in (env, env.unwrapped.simulation, env.unwrapped.controller):
        with pytest.raises(InvalidInputError, match="cannot be copied"):
            duplicate(part)


@pytest.mark.parametrize("env_id", ENV_IDS)
@pytest.mark.parametrize("scenario", SHORT_SCENES)
def test_infos_are_consistent_and_the_reward_is_the_sum_of_its_terms(env_id, scenario):
    more = {"diagnostics": True} if env_id == "HCBF-A1Regions-v0" else {}
    env = filtered(env_id, scenario=scenario, **more)
    inner = env.unwrapped
    record = run(env, 40)
    at_reset = {key: np.shape(value) for key, value in flat(record[0][2])}
    for observation, reward, info in record[1:]:
        assert {key: np.shape(value) for key, value in flat(info)} == at_reset
        assert reward == pytest.approx(
            sum(value for key, value in info.items() if key.startswith("reward_"))
        )
        np.testing.assert_array_equal(info["violation"], np.maximum(0.0, -info["h"]))
        ranks = np.array([barrier.priority for barrier in inner.barriers])
        assert info["cost"] == float((info["min_h"][ranks == 1] < 0.0).any())
        deep = np.where([b.reads_position for b in inner.barriers], -info["min_h"], 0.0)
        for rank, depth in enumerate(info["costs"], start=1):
            assert depth == max(0.0, *deep[ranks == rank])
        assert (info["min_h"] <= info["h"] + 1e-12).all()
        assert len(info["h"]) == len(inner.barriers)
        record = info["safety_filter"]
        gap = np.linalg.norm(record["u_safe"] - record["u_nominal"])
        assert record["intervention"] == pytest.approx(gap)
        assert FilterStatus(int(record["status"])) is not FilterStatus.BACKUP
        assert np.isfinite(observation).all()
        for key, value in flat(info):
            kind = (
                np.int64
                if key in ("status", "reason", "covered", "covered_by", "proved")
                else np.float64
            )
            assert isinstance(value, kind | np.ndarray), key
            assert value.dtype == kind, key
            assert np.isfinite(value).all(), key
    arrays = [
        id(v) for _, _, info in [run(env, 2)[-1]] for _, v in flat(info) if not np.isscalar(v)
    ]
    assert len(arrays) == len(set(arrays))
    env.close()


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_the_observation_is_what_the_documentation_says(env_id):
    env = gym.make(env_id)
    inner = env.unwrapped
    observation, info = run(env, 30)[-1][::2]
    position, velocity = inner.rom_state[:2], inner.rom_state[2:]
    wanted, speed = inner.scenario.reference(inner.time)
    np.testing.assert_allclose(observation[0:2], wanted - position, atol=1e-12)
    np.testing.assert_allclose(observation[2:4], speed - velocity, atol=1e-12)
    np.testing.assert_allclose(observation[4:6], velocity, atol=1e-12)
    np.testing.assert_allclose(
        observation[6:8], inner.scenario.reference.acceleration(inner.time), atol=1e-12
    )
    m = len(inner.scenario.barriers)
    per_barrier = observation[8:].reshape(m, 4)
    np.testing.assert_allclose(per_barrier[:, 0], info["h"][:m], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(per_barrier[:, 1:3], axis=1), 1.0)
    assert info["tracking_error"] == pytest.approx(np.linalg.norm(wanted - position))


@pytest.mark.parametrize(
    "make",
    [
        *(functools.partial(filtered, env_id) for env_id in ENV_IDS),
        functools.partial(filtered, "HCBF-WalkerRegions-v0", robot="cart", scenario="random"),
    ],
    ids=[*ENV_IDS, "cart"],
)
def test_gymnasiums_vector_environments_run_it(make):
    # spawned, not forked: other tests of this process may have started JAX's threads
    spawned = functools.partial(gym.vector.AsyncVectorEnv, context="spawn")
    for vector in (gym.vector.SyncVectorEnv, spawned):
        envs = vector([make] * 2)
        envs.reset(seed=0)
        for _ in range(3):
            _, reward, *_, info = envs.step(np.zeros((2, 2), dtype=np.float32))
        assert reward.shape == (2,)
        assert info["safety_filter"]["slack"].shape[0] == 2
        assert info["h"].dtype == np.float64
        envs.close()


@pytest.mark.parametrize("env_id", ENV_IDS)
@pytest.mark.parametrize(
    "action", [np.full(2, np.nan), np.array([np.inf, 0.0]), np.zeros(3), np.zeros((1, 2))]
)
def test_bad_actions_are_refused_before_anything_moves(env_id, action):
    env = gym.make(env_id)
    env.reset(seed=0)
    before = env.unwrapped.rom_state
    with pytest.raises(InvalidInputError, match="expected"):
        env.step(action)
    np.testing.assert_array_equal(env.unwrapped.rom_state, before)
    env.close()


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_bad_arguments_are_refused_with_the_choices(env_id):
    with pytest.raises(UnknownNameError, match="paper-four-levels"):
        gym.make(env_id, scenario="nowhere")
    env = gym.make(env_id)
    with pytest.raises(HcbfError, match="rgb_array"):
        type(env.unwrapped)(render_mode="ascii")
    with pytest.raises(UnknownNameError, match="r-cbf-qp"):
        wrappers.SafetyFilter(env, program="x-cbf-qp")
    with pytest.raises(UnknownNameError, match="daqp"):
        wrappers.SafetyFilter(env, solver="abacus")
    with pytest.raises(InvalidInputError, match="gamma0"):
        wrappers.SafetyFilter(env, program="h-cbf-qp", gamma=1.0)
    with pytest.raises(InvalidInputError, match="margin"):
        wrappers.SafetyFilter(env, program="h-cbf-qp", margin=-0.1)
    with pytest.raises(InvalidInputError, match="barriers"):
        wrappers.SafetyFilter(gym.make("CartPole-v1"), program="h-cbf-qp")
    env.close()


def test_the_a1_refuses_what_only_it_could_misread():
    with pytest.raises(InvalidInputError, match="divides"):
        A1RegionsEnv(timestep=0.003)
    with pytest.raises(UnknownNameError, match="measured"):
        A1RegionsEnv(feedback="guessed")
    with pytest.raises(HcbfError, match="expected"):
        A1RegionsEnv(xml_file="nothing.xml")
    with pytest.raises(InvalidInputError, match="at most"):
        A1RegionsEnv(scenario=replace(scenarios.make("paper-simulation"), v_max=3.0))
    with pytest.raises(UnknownNameError, match="rough"):
        A1RegionsEnv(terrain="lunar")
    with pytest.raises(UnknownNameError, match="trot"):
        A1RegionsEnv(gait="gallop")
    with pytest.raises(InvalidInputError, match="payload"):
        A1RegionsEnv(randomization={"load": 3.0})
    with pytest.raises(InvalidInputError, match="low <= high"):
        A1RegionsEnv(randomization={"payload": [3.0, 1.0]})
    with pytest.raises(InvalidInputError, match="expected"):
        A1RegionsEnv(disturbances={"kind": "random", "interval": -1.0, "impulse": [0.0, 1.0]})


def test_a_randomised_episode_is_decided_by_its_seed():
    settings = {
        "randomization": {"payload": [0.0, 4.0], "start_distance": [0.05, 0.1], "start_yaw": 0.2},
        "disturbances": {"kind": "random", "interval": 0.2, "impulse": [5.0, 10.0]},
        "diagnostics": True,
    }

    def end(seed):
        env = gym.make("HCBF-A1Regions-v0", **settings)
        state = env.reset(seed=seed)[0], run(env, 30, seed)[-1][0]
        env.close()
        return state

    (start, one), (_, again), (elsewhere, other) = end(1), end(1), end(2)
    np.testing.assert_array_equal(one, again)
    assert np.abs(one - other).max() > 1e-3
    assert 0.05 <= np.linalg.norm(start[:2]) <= 0.1
    assert np.abs(start - elsewhere).max() > 1e-3


def test_a_fall_ends_the_episode_without_an_exception_or_a_nan():
    shove = {"time": 0.2, "duration": 0.2, "force": [0.0, 900.0, 0.0]}
    env = gym.make(
        "HCBF-A1Regions-v0", disturbances={"kind": "scheduled", "pushes": [shove]}, diagnostics=True
    )
    record = run(env, 200)
    assert record[-1][2]["fallen"] == 1.0
    assert len(record) < 200
    for observation, reward, info in record:
        assert np.isfinite(observation).all()
        assert np.isfinite(reward)
        assert not any(np.isnan(value).any() for _, value in flat(info))
    env.close()


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_a_picture_can_be_taken_and_close_is_safe_twice(env_id, request):
    if env_id == "HCBF-A1Regions-v0":
        request.getfixturevalue("opengl")
    env = gym.make(env_id, render_mode="rgb_array")
    env.reset(seed=0)
    frame = env.render()
    assert frame.dtype == np.uint8
    assert frame.ndim == 3
    assert frame.std() > 10.0
    env.close()
    env.close()


def test_human_rendering_without_a_display_says_what_to_do(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    env = gym.make("HCBF-A1Regions-v0", render_mode="human")
    env.reset(seed=0)
    with pytest.raises(RenderingError, match="rgb_array"):
        env.render()
    env.close()


def test_the_public_names_are_there():
    assert set(hcbf_gym.scenarios.names()) >= {
        "paper-simulation",
        "paper-simulation-as-printed",
        "paper-four-levels",
        "paper-experiment",
    }
    assert {"cbf-qp", "r-cbf-qp", "h-cbf-qp"} <= set(programs.names())


def test_mujocos_model_and_data_stand_where_gymnasium_has_them():
    env = gym.make("HCBF-A1Regions-v0").unwrapped
    env.reset(seed=0)
    assert env.model.nu == 12
    assert env.data.qpos[:2] == pytest.approx(env.truth[:2])
