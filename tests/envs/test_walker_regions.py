"""HCBF-WalkerRegions-v0 as users of Gymnasium expect it, on the carts and on learned walkers."""

import copy
import json
import pickle
import sys
import warnings
from itertools import islice
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

from hcbf_gym import certificates, policies, wrappers
from hcbf_gym.errors import (
    CoverageWarning,
    HcbfError,
    InvalidInputError,
    SafetyWarning,
    UnknownNameError,
)
from hcbf_gym.evaluation.episode import samples
from hcbf_robots.envs.walker_regions import WalkerRegionsEnv
from hcbf_robots.walkers.walker import NAMES

sys.path.insert(0, str(Path(__file__).parents[1] / "robots"))
from walkers import CARTS, LEARNED, plain

ENV = "HCBF-WalkerRegions-v0"
ROBOTS = (*CARTS, *LEARNED)

ABOUT_SPACES = ("minimum value", "maximum value", "symmetric and normalized")


def filtered(robot, **arguments):
    return wrappers.SafetyFilter(gym.make(ENV, robot=robot, **arguments))


def run(env, steps, seed=0):
    walk = islice(samples(env, policies.PDTracker.for_env(env), seed), steps + 1)
    return [(sample.observation, sample.reward, sample.info) for sample in walk]


def flat(info):
    for key, value in sorted(info.items()):
        yield from flat(value) if isinstance(value, dict) else [(key, value)]


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("make", [gym.make, filtered], ids=["bare", "filtered"])
def test_gymnasiums_checker_has_nothing_to_say(robot, make):
    env = make(robot, v_max=0.8) if make is filtered else gym.make(ENV, robot=robot, v_max=0.8)
    inner = env if make is filtered else env.unwrapped
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(inner, skip_render_check=True)
    others = [str(w.message) for w in caught if not any(s in str(w.message) for s in ABOUT_SPACES)]
    others = [
        text
        for text in others
        if "different from the unwrapped version" not in text and "covered = 0" not in text
    ]
    assert others == []
    env.close()


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_filtered_walker_is_rebuilt_from_its_spec(robot):
    env = filtered(robot, scenario="random", v_max=1.0, body="footprint")
    spec = EnvSpec.from_json(env.spec.to_json())
    assert spec == env.spec
    again = gym.make(spec)
    for one, other in zip(run(env, 5), run(again, 5), strict=True):
        np.testing.assert_array_equal(one[0], other[0])


@pytest.mark.parametrize("robot", ROBOTS)
def test_two_runs_of_one_seed_are_identical(robot):
    first, second = (run(filtered(robot, scenario="random"), 60, seed=3) for _ in range(2))
    for (o1, r1, i1), (o2, r2, i2) in zip(first, second, strict=True):
        np.testing.assert_array_equal(o1, o2)
        assert r1 == r2
        for (k1, v1), (k2, v2) in zip(flat(i1), flat(i2), strict=True):
            assert k1 == k2
            np.testing.assert_array_equal(v1, v2)


@pytest.mark.parametrize("robot", CARTS)
@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_moves_alike_or_is_refused(robot, duplicate):
    env = filtered(robot, scenario="random")
    other = duplicate(env)
    for (first, _, _), (second, _, _) in zip(run(env, 4), run(other, 4), strict=True):
        np.testing.assert_array_equal(first, second)
    for part in (env, env.unwrapped.simulation):
        with pytest.raises(InvalidInputError, match="cannot be copied"):
            duplicate(part)


def of_the_trunk(env):
    """Return h (m,) where the trunk is: the point before a differential drive is outside of it."""
    x = np.array([[*env.data.qpos[:2], 0.0, 0.0]])
    return env.barrier_set.along(x, np.array([env.time]))[0]


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("body", ["point", "footprint"])
def test_infos_are_consistent_and_the_reward_is_the_sum_of_its_terms(robot, body):
    env = filtered(robot, body=body)
    record = run(env, 40)
    at_reset = {key: np.shape(value) for key, value in flat(record[0][2])}
    for observation, reward, info in record[1:]:
        assert {key: np.shape(value) for key, value in flat(info)} == at_reset
        terms = sum(value for key, value in info.items() if key.startswith("reward_"))
        assert reward == pytest.approx(terms)
        assert (info["min_h"] <= info["h"] + 1e-12).all()
        assert len(info["h"]) == len(env.unwrapped.barriers)
        if body == "footprint":
            assert (info["min_body_h"] <= info["body_h"]).all()
        assert np.isfinite(observation).all()
        for key, value in flat(info):
            kind = (
                np.int64
                if key in ("status", "reason", "covered", "covered_by", "proved")
                else np.float64
            )
            assert value.dtype == kind, key
    if body == "footprint":
        m = len(env.unwrapped.scenario.barriers)
        assert (record[-1][2]["body_h"][:m] < of_the_trunk(env.unwrapped)[:m]).all()
    env.close()


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_reference_velocity_is_the_models_own(robot):
    env = gym.make(ENV, robot=robot, scenario="random")
    env.reset(seed=0)
    rng, velocity = np.random.default_rng(0), np.zeros(2)
    for _ in range(20):
        u = rng.uniform(-2.0, 2.0, 2)
        before = env.unwrapped.simulation.yaw
        env.step(u)
        velocity += 0.02 * u
        if env.unwrapped.contract.command.look_ahead is not None:  # it turns with the heading
            turn = env.unwrapped.simulation.yaw - before
            cos, sin = np.cos(turn), np.sin(turn)
            velocity = np.array([[cos, -sin], [sin, cos]]) @ velocity
        np.testing.assert_allclose(env.unwrapped.rom_state[2:], velocity, atol=1e-12)
        np.testing.assert_array_equal(env.unwrapped.rom_state[:2], env.unwrapped.drive.truth[:2])


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("direction", [0.0, 2.0])
def test_the_robot_follows_the_models_velocity_in_the_world(robot, direction):
    """A second after a ramp to .4 m/s the mean velocity is near it, whatever the heading is.

    A cart's velocity turns with its heading, so that an acceleration has to bring it back.
    """
    env = gym.make(ENV, robot=robot, scenario="random")
    env.reset(seed=0)
    wanted = 0.4 * np.array([np.cos(direction), np.sin(direction)])
    seen = []
    for k in range(250):
        u = wanted / 0.4 if k < 20 else np.zeros(2)
        if env.unwrapped.contract.command.look_ahead is not None:
            u = np.clip(8.0 * (wanted - env.unwrapped.rom_state[2:]), -5.0, 5.0)
        _, _, terminated, _, _ = env.step(u)
        assert not terminated
        seen.append(env.unwrapped.drive.truth[2:])
    np.testing.assert_allclose(np.mean(seen[150:], axis=0), wanted, atol=0.1)


def test_the_heading_follows_its_rule():
    def turned(heading):
        env = gym.make(ENV, robot="holonomic-cart", scenario="random", heading=heading)
        env.reset(seed=0)
        inner = env.unwrapped
        first, inner.drive.adapter.turn = inner.simulation.yaw, 0.3
        for k in range(200):
            env.step(np.array([0.0, 1.0]) if k < 40 else np.zeros(2))
        return inner.simulation.yaw - first, np.pi / 2 - first

    for heading, expected in (
        ("velocity", lambda first: first),
        ("fixed", lambda first: 0.0),
        ("free", lambda first: 0.3 * 4.0),
    ):
        moved, quarter = turned(heading)
        assert moved == pytest.approx(expected(quarter), abs=0.1), heading


def test_the_look_ahead_point_is_what_stands_at_the_start_and_moves():
    env = gym.make(ENV, robot="cart", scenario="random")
    env.reset(seed=0)
    inner = env.unwrapped
    np.testing.assert_allclose(inner.drive.truth[:2], inner.scenario.start, atol=1e-9)
    np.testing.assert_allclose(inner.truth[:2], inner.data.qpos[:2], atol=1e-9)
    ahead = inner.drive.truth[:2] - inner.truth[:2]
    assert np.linalg.norm(ahead) == pytest.approx(inner.contract.command.look_ahead)
    before = inner.drive.truth
    for _ in range(10):
        env.step(np.array([1.0, -1.0]))
    moved = np.diff([before[:2], inner.drive.truth[:2]], axis=0)[0]
    assert moved @ np.array([1.0, -1.0]) > 0.0


@pytest.mark.parametrize("robot", ROBOTS)
def test_pushes_payload_friction_and_rough_ground_change_the_episode_by_its_seed(robot):
    settings = {
        "terrain": "rough",
        "randomization": {"payload": [0.5, 1.0], "floor_friction": [0.6, 0.9], "start_yaw": 0.2},
        "disturbances": {"kind": "random", "interval": 0.3, "impulse": [0.5, 1.0]},
    }

    def end(seed):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            env = gym.make(ENV, robot=robot, **settings)
        return run(env, 30, seed)[-1][0]

    np.testing.assert_array_equal(end(1), end(1))
    assert np.abs(end(1) - end(2)).max() > 1e-4


def test_what_was_not_certified_is_not_covered(tmp_path):
    contract = json.loads(NAMES["cart"].read_text()) | {"name": "mine"}
    contract["mjcf"] = str(NAMES["cart"].with_suffix(".xml"))
    (tmp_path / "mine.json").write_text(json.dumps(contract))
    with pytest.warns(CoverageWarning, match="robot 'mine'"):
        env = filtered(str(tmp_path / "mine.json"), scenario="random")
    assert env.reset(seed=0)[1]["safety_filter"]["covered"] == 0


def test_a_shipped_certificate_covers_its_walker_and_gives_the_margins(released):
    shipped = certificates.shipped()["cart"]
    with warnings.catch_warnings():
        warnings.simplefilter("error", CoverageWarning)
        env = filtered("cart", scenario="random")
    assert env.reset(seed=0)[1]["safety_filter"]["covered"] == 1
    assert env.unwrapped.plant.uncertainty == shipped.margins
    with pytest.warns(CoverageWarning, match="terrain 'rough'"):
        gym.make(ENV, robot="cart", terrain="rough")


@pytest.mark.parametrize("options", [{"body": "footprint"}, {"terrain": "rough"}, {"v_max": 0.5}])
def test_elsewhere_a_robot_reserves_no_less_than_its_certificate(options):
    found = certificates.shipped()["cart"].margins
    reserved = gym.make(ENV, robot="cart", **options).unwrapped.plant.uncertainty
    assert reserved.distance >= found.distance
    assert reserved.speed >= found.speed


class Broken:
    """A controller that gives NaN from its tenth action on."""

    def __init__(self):
        self.count = 0

    def __call__(self, observation):
        self.count += 1
        return observation * (np.nan if self.count > 10 else 1.0)


def broken(model, period):
    return Broken()


def test_a_controller_that_gives_nan_ends_the_episode_with_the_last_inputs(tmp_path):
    import json

    from hcbf_robots import carts

    contract = plain(carts.FOLDER / "holonomic-cart.json")
    contract["mjcf"] = str(carts.FOLDER / contract["mjcf"])
    contract["policy"] = f"{__name__}:broken"
    sys.modules.setdefault(__name__, sys.modules[broken.__module__])
    path = tmp_path / "broken.json"
    path.write_text(json.dumps(contract))
    env = gym.make(ENV, robot=str(path))
    env.reset(seed=0)
    for _ in range(10):
        _, _, terminated, _, info = env.step(np.array([1.0, 0.0]))
        assert not terminated
        assert info["controller_failed"] == 0.0
    last = env.unwrapped.data.ctrl.copy()
    with pytest.warns(SafetyWarning, match="no finite action"):
        observation, reward, terminated, _, info = env.step(np.array([1.0, 0.0]))
    assert terminated
    assert info["controller_failed"] == 1.0
    assert info["fallen"] == 0.0
    np.testing.assert_array_equal(env.unwrapped.data.ctrl, last)
    assert np.isfinite(observation).all()
    assert np.isfinite(reward)


@pytest.mark.parametrize("robot", LEARNED)
def test_a_network_that_gives_nan_leaves_the_last_joint_targets(robot, monkeypatch):
    from hcbf_gym.loading import Network

    env = gym.make(ENV, robot=robot, scenario="random")
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.array([0.5, 0.0]))
    targets = env.unwrapped.data.ctrl.copy()
    monkeypatch.setattr(Network, "__call__", lambda self, observation: np.full(12, np.nan))
    with pytest.warns(SafetyWarning, match=r"policy\.onnx gave no finite action"):
        _, _, terminated, _, info = env.step(np.array([0.5, 0.0]))
    assert terminated
    assert info["controller_failed"] == 1.0
    np.testing.assert_array_equal(env.unwrapped.data.ctrl, targets)


@pytest.mark.parametrize("action", [np.full(2, np.nan), np.zeros(3), "left"])
def test_bad_actions_are_refused_before_anything_moves(action):
    env = gym.make(ENV)
    env.reset(seed=0)
    before = env.unwrapped.rom_state
    with pytest.raises(InvalidInputError, match="expected"):
        env.step(action)
    np.testing.assert_array_equal(env.unwrapped.rom_state, before)


def test_bad_arguments_are_refused_with_the_choices():
    with pytest.raises(UnknownNameError, match="holonomic-cart"):
        gym.make(ENV, robot="tractor")
    with pytest.raises(UnknownNameError, match="velocity"):
        gym.make(ENV, heading="north")
    with pytest.raises(UnknownNameError, match="footprint"):
        gym.make(ENV, body="shadow")
    with pytest.raises(InvalidInputError, match="at most"):
        gym.make(ENV, v_max=3.0)
    with pytest.raises(InvalidInputError, match="no speed is left"):
        gym.make(ENV, v_max=0.01)
    with pytest.raises(InvalidInputError, match="sensor_noise"):
        gym.make(ENV, randomization={"sensor_noise": 1.0})
    with pytest.raises(HcbfError, match="rgb_array"):
        WalkerRegionsEnv(render_mode="ascii")


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_picture_shows_the_robot(robot, opengl):
    """The picture of a robot differs from the empty scene's where the robot stands."""
    env = gym.make(ENV, robot=robot, render_mode="rgb_array")
    env.reset(seed=0)
    with_robot = env.render()
    model = env.unwrapped.model
    model.geom_rgba[model.body_rootid[model.geom_bodyid] == 1, 3] = 0.0
    without = env.render()
    changed = (np.abs(with_robot.astype(int) - without.astype(int)).max(axis=2) > 20).sum()
    assert changed > 500
    env.close()


@pytest.mark.parametrize(
    ("scene", "v_max", "way"),
    [("paper-simulation", None, 0.0), ("paper-simulation", 0.5, 24.0), ("random", None, 40.0)],
)
def test_the_time_limit_follows_the_robots_speed(scene, v_max, way):
    given = {"robot": "holonomic-cart", "scenario": scene, "v_max": v_max}
    env = gym.make(ENV, **given)
    fastest = env.unwrapped.fastest
    env.reset(seed=0)
    steps, truncated = 0, False
    while not truncated and steps < 10_000:
        truncated, steps = env.step(np.zeros(2))[3], steps + 1
    assert steps == pytest.approx(max(20.0, way / fastest) / 0.02, abs=1)
    assert gym.make(env.spec).spec == env.spec
    short = gym.make(ENV, **given, max_episode_steps=7)
    short.reset(seed=0)
    assert [short.step(np.zeros(2))[3] for _ in range(7)] == [*[False] * 6, True]
    longer = gym.make(ENV, **given, max_episode_steps=steps + 1)
    longer.reset(seed=0)
    assert not any(longer.step(np.zeros(2))[3] for _ in range(steps))
