"""The environments of one robot, bare and filtered, as users of Gymnasium and SB3 expect them."""

import copy
import functools
import pickle
import warnings
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from kinds import A1, CARTS, CODES, KINDS, ROM, WALKER, every, filtered, flat, make, only, run
from needs import needs

from hcbf_gym import HcbfError, scenarios, wrappers
from hcbf_gym.errors import InvalidInputError, RenderingError, UnknownNameError
from hcbf_gym.programs import FilterStatus

# Accelerations are in SI units and observations are unbounded, both on purpose.
EXPECTED = (
    "minimum value",
    "maximum value",
    "symmetric and normalized",
    "different from the unwrapped version",
    "covered = 0",
)


def warned(check):
    """Return what a check warned of, besides what is meant."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check()
    texts = [str(one.message) for one in caught]
    return [text for text in texts if not any(part in text for part in EXPECTED)]


@pytest.mark.usefixtures("released")
@every
@pytest.mark.parametrize("making", [make, filtered], ids=["bare", "filtered"])
def test_gymnasiums_checker_finds_nothing(kind, making):
    env = making(kind) if kind in (ROM, A1) else making(kind, v_max=0.8)
    inner = env if making is filtered else env.unwrapped
    assert warned(lambda: check_env(inner, skip_render_check=True)) == []
    env.close()


@needs("stable_baselines3")
@only(ROM, A1)
@pytest.mark.parametrize("making", [make, filtered], ids=["bare", "filtered"])
def test_sb3s_checker_finds_nothing(kind, making):
    from stable_baselines3.common import env_checker as sb3_env_checker

    env = making(kind)
    assert warned(lambda: sb3_env_checker.check_env(env)) == []
    env.close()


@every
def test_a_filtered_environment_is_rebuilt_from_its_spec(kind):
    options = {
        ROM: {"scenario": "paper-experiment"},
        A1: {"scenario": "paper-experiment", "estimation": {"drift": 0.03, "rate": 10.0}},
    }.get(kind, {"scenario": "random", "v_max": 1.0, "body": "footprint"})
    env = wrappers.SafetyFilter(
        make(kind, **options),
        program="h-cbf-qp",
        gamma0=2.0,
        alpha1={"kind": "log", "phi1": 0.8},
        margin=0.05,
    )
    spec = EnvSpec.from_json(env.spec.to_json())
    assert spec == env.spec
    for rebuilt in (gym.make(spec), env.spec.make()):
        assert "SafetyFilter" in str(rebuilt)
        for one, other in zip(run(env, 5), run(rebuilt, 5), strict=True):
            np.testing.assert_array_equal(one[0], other[0])
        rebuilt.close()
    env.close()


@every
def test_two_runs_of_one_seed_are_identical(kind):
    first, second = (run(filtered(kind, scenario="random"), 60, seed=3) for _ in range(2))
    for (o1, r1, i1), (o2, r2, i2) in zip(first, second, strict=True):
        np.testing.assert_array_equal(o1, o2)
        assert r1 == r2
        for (k1, v1), (k2, v2) in zip(flat(i1), flat(i2), strict=True):
            assert k1 == k2
            np.testing.assert_array_equal(v1, v2)


@only(A1, *CARTS)
@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_of_a_simulated_robot_moves_alike_or_is_refused(kind, duplicate):
    env = filtered(kind, scenario="random")
    other = duplicate(env)
    assert other.unwrapped.spec == env.unwrapped.spec
    for (first, _, _), (second, _, _) in zip(run(env, 4), run(other, 4), strict=True):
        np.testing.assert_array_equal(first, second)
    inner = env.unwrapped
    for part in (env, inner.simulation, *([inner.controller] if kind == A1 else [])):
        with pytest.raises(InvalidInputError, match="cannot be copied"):
            duplicate(part)


@every
@pytest.mark.parametrize("scenario", ["paper-simulation", "paper-experiment"])
@pytest.mark.parametrize("body", ["point", "footprint"])
def test_infos_are_consistent_and_the_reward_is_the_sum_of_its_terms(kind, scenario, body):
    more = {} if kind == ROM else {"body": body}  # the model is a point
    env = filtered(kind, scenario=scenario, **more, **({"diagnostics": True} if kind == A1 else {}))
    inner = env.unwrapped
    record = run(env, 40)
    at_reset = {key: np.shape(value) for key, value in flat(record[0][2])}
    ranks = np.array([barrier.priority for barrier in inner.barriers])
    has_metres = [b.reads_position for b in inner.barriers]
    for observation, reward, info in record[1:]:
        assert {key: np.shape(value) for key, value in flat(info)} == at_reset
        terms = sum(value for key, value in info.items() if key.startswith("reward_"))
        assert reward == pytest.approx(terms)
        np.testing.assert_array_equal(info["violation"], np.maximum(0.0, -info["h"]))
        least = np.minimum(info["min_h"], info.get("min_body_h", np.inf))
        assert info["cost"] == float((least[ranks == 1] < 0.0).any())
        deep = np.where(has_metres, -least, 0.0)
        for rank, depth in enumerate(info["costs"], start=1):
            assert depth == max(0.0, *deep[ranks == rank])
        assert (info["min_h"] <= info["h"] + 1e-12).all()
        assert len(info["h"]) == len(inner.barriers)
        report = info["safety_filter"]
        gap = np.linalg.norm(report["u_safe"] - report["u_nominal"])
        assert report["intervention"] == pytest.approx(gap)
        assert FilterStatus(int(report["status"])) is not FilterStatus.BACKUP
        assert np.isfinite(observation).all()
        for key, value in flat(info):
            dtype = np.int64 if key in CODES else np.float64
            assert isinstance(value, dtype | np.ndarray), key
            assert value.dtype == dtype, key
            is_finite = np.isfinite(value).all()
            assert is_finite or key.endswith("body_h"), key  # a speed limit has no distance
    arrays = [id(value) for _, value in flat(run(env, 2)[-1][2]) if not np.isscalar(value)]
    assert len(arrays) == len(set(arrays))
    if more.get("body") == "footprint":
        assert (info["min_body_h"] <= info["body_h"]).all()
        place = np.array([[*inner.data.qpos[:2], 0.0, 0.0]])
        h = inner.barrier_set.along(place, np.array([inner.time]))[0]
        m = len(inner.scenario.barriers)
        assert (record[-1][2]["body_h"][:m] < h[:m]).all() or kind == A1
    env.close()


@every
def test_the_observation_is_as_documented(kind):
    env = make(kind)
    inner = env.unwrapped
    observation, _, info = run(env, 30)[-1]
    position, velocity = inner.rom_state[:2], inner.rom_state[2:]
    reference, speed = inner.scenario.reference(inner.time)
    acceleration = inner.scenario.reference.acceleration(inner.time)
    expected = [reference - position, speed - velocity, velocity, acceleration]
    np.testing.assert_allclose(observation[:8], np.concatenate(expected), atol=1e-12)
    per_barrier = observation[8:].reshape(len(inner.scenario.barriers), 4)
    np.testing.assert_allclose(np.linalg.norm(per_barrier[:, 1:3], axis=1), 1.0)
    if kind in (ROM, A1):  # of others a point before the axle follows the reference
        h = info["h"][: len(per_barrier)]
        np.testing.assert_allclose(per_barrier[:, 0], h, atol=1e-12)
    assert info["tracking_error"] == pytest.approx(np.linalg.norm(reference - position))


@only(ROM, A1, "cart")
def test_gymnasiums_vector_environments_run_it(kind):
    making = functools.partial(filtered, kind, scenario="random")
    # spawned, not forked: other tests of this process may have started JAX's threads
    spawned = functools.partial(gym.vector.AsyncVectorEnv, context="spawn")
    for vector in (gym.vector.SyncVectorEnv, spawned):
        envs = vector([making] * 2)
        envs.reset(seed=0)
        for _ in range(3):
            _, reward, *_, info = envs.step(np.zeros((2, 2), dtype=np.float32))
        assert reward.shape == (2,)
        assert info["safety_filter"]["slack"].shape[0] == 2
        assert info["h"].dtype == np.float64
        envs.close()


NO_ACTIONS = (
    np.full(2, np.nan), np.array([np.inf, 0.0]), np.zeros(3), np.zeros((1, 2)), "left",
    np.array([1j, 0.0]), 1j, ["a", "b"], {}, {"u": 1.0}, None, [[1.0], 2.0],
)  # fmt: skip


@only(ROM, A1, "cart")
@pytest.mark.parametrize("making", [make, filtered], ids=["bare", "filtered"])
@pytest.mark.parametrize("action", NO_ACTIONS, ids=repr)
def test_bad_actions_are_refused_before_anything_moves(kind, making, action):
    env = making(kind, disable_env_checker=True)
    env.reset(seed=0)
    before = env.unwrapped.rom_state
    with pytest.raises(InvalidInputError, match="expected"):
        env.step(action)
    np.testing.assert_array_equal(env.unwrapped.rom_state, before)
    env.close()


@only(ROM, A1, "cart")
def test_bad_arguments_are_refused_with_the_choices(kind):
    with pytest.raises(UnknownNameError, match="paper-four-levels"):
        make(kind, scenario="nowhere")
    env = make(kind)
    with pytest.raises(HcbfError, match="rgb_array"):
        type(env.unwrapped)(render_mode="ascii")
    env.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"program": "x-cbf-qp"}, "r-cbf-qp"),
        ({"solver": "abacus"}, "daqp"),
        ({"program": "h-cbf-qp", "gamma": 1.0}, "gamma0"),
        ({"program": "h-cbf-qp", "margin": -0.1}, "margin"),
    ],
)
def test_a_filter_refuses_bad_arguments_with_the_choices(options, message):
    with pytest.raises(InvalidInputError, match=message):
        wrappers.SafetyFilter(make(ROM), **options)


def test_a_filter_refuses_an_environment_without_a_plant():
    with pytest.raises(InvalidInputError, match="barriers"):
        wrappers.SafetyFilter(gym.make("CartPole-v1"), program="h-cbf-qp")


@pytest.mark.parametrize(
    ("env_id", "options", "error", "message"),
    [
        (A1, {"timestep": 0.003}, InvalidInputError, "divides"),
        (A1, {"feedback": "guessed"}, UnknownNameError, "measured"),
        (A1, {"xml_file": "nothing.xml"}, HcbfError, "expected"),
        (A1, {"gait": "gallop"}, UnknownNameError, "trot"),
        (
            A1,
            {"scenario": replace(scenarios.make("paper-simulation"), v_max=3.0)},
            InvalidInputError,
            "at most",
        ),
        (WALKER, {"robot": "tractor"}, UnknownNameError, "holonomic-cart"),
        (WALKER, {"heading": "north"}, UnknownNameError, "velocity"),
        (WALKER, {"body": "shadow"}, UnknownNameError, "footprint"),
        (WALKER, {"v_max": 3.0}, InvalidInputError, "at most"),
        (WALKER, {"v_max": 0.01}, InvalidInputError, "no speed is left"),
        (WALKER, {"randomization": {"sensor_noise": 1.0}}, InvalidInputError, "sensor_noise"),
    ],
)
def test_arguments_of_one_robot_are_refused_with_the_choices(env_id, options, error, message):
    with pytest.raises(error, match=message):
        gym.make(env_id, **options)


@only(A1, *KINDS[2:])
def test_a_randomised_episode_is_decided_by_its_seed(kind):
    light = kind != A1
    options = {
        "terrain": "rough" if light else "flat",
        "randomization": {
            "payload": [0.0, 1.0 if light else 4.0],
            "floor_friction": [0.6, 0.9],
            "start_distance": [0.05, 0.1],
            "start_yaw": 0.2,
        },
        "disturbances": {
            "kind": "random",
            "interval": 0.2,
            "impulse": [0.5, 1.0] if light else [5.0, 10.0],
        },
    }

    def ends(seed):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            env = make(kind, **options)
        record = run(env, 30, seed)
        env.close()
        return record[0][0], record[-1][0]

    (start, one), (_, again), (elsewhere, other) = ends(1), ends(1), ends(2)
    np.testing.assert_array_equal(one, again)
    assert np.abs(one - other).max() > 1e-4
    assert np.abs(start - elsewhere).max() > 1e-3
    assert 0.05 - 1e-9 <= np.linalg.norm(start[:2]) <= 0.1 + 1e-9 or light


def test_a_fall_ends_the_episode_without_an_exception_or_a_nan():
    shove = {"time": 0.2, "duration": 0.2, "force": [0.0, 900.0, 0.0]}
    pushes = {"kind": "scheduled", "pushes": [shove]}
    env = make(A1, disturbances=pushes, diagnostics=True)
    record = run(env, 200)
    assert record[-1][2]["fallen"] == 1.0
    assert len(record) < 200
    for observation, reward, info in record:
        assert np.isfinite(observation).all()
        assert np.isfinite(reward)
        assert not any(np.isnan(value).any() for _, value in flat(info))
    env.close()


@every
def test_a_picture_shows_the_robot_and_close_is_safe_twice(kind, request):
    if kind != ROM:
        request.getfixturevalue("opengl")
    env = make(kind, render_mode="rgb_array")
    env.reset(seed=0)
    frame = env.render()
    assert frame.dtype == np.uint8
    assert frame.ndim == 3
    assert frame.std() > 10.0
    if kind != ROM:
        model = env.unwrapped.model
        model.geom_rgba[model.body_rootid[model.geom_bodyid] == 1, 3] = 0.0
        changed = np.abs(frame.astype(int) - env.render().astype(int)).max(axis=2) > 20
        assert changed.sum() > 500
    env.close()
    env.close()


def test_human_rendering_without_a_display_names_the_other_mode(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    env = make(A1, render_mode="human")
    env.reset(seed=0)
    with pytest.raises(RenderingError, match="rgb_array"):
        env.render()
    env.close()
