"""HCBF-WalkerRegions-v0 as users of Gymnasium expect it, on the carts and on learned walkers."""

import json
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from kinds import LEARNED, WALKER, WALKERS, filtered
from walkers import plain

from hcbf_gym import certificates
from hcbf_gym.errors import CoverageWarning, SafetyWarning
from hcbf_robots import carts
from hcbf_robots.walkers.walker import NAMES


@pytest.mark.parametrize("robot", WALKERS)
def test_the_reference_velocity_is_the_models_own(robot):
    env = gym.make(WALKER, robot=robot, scenario="random")
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


@pytest.mark.parametrize("robot", WALKERS)
@pytest.mark.parametrize("direction", [0.0, 2.0])
def test_the_robot_follows_the_models_velocity_in_the_world(robot, direction):
    """A second after a ramp to .4 m/s the mean velocity is near it, whatever the heading is.

    A cart's velocity turns with its heading, so that an acceleration has to bring it back.
    """
    env = gym.make(WALKER, robot=robot, scenario="random")
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
        env = gym.make(WALKER, robot="holonomic-cart", scenario="random", heading=heading)
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
    env = gym.make(WALKER, robot="cart", scenario="random")
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
        gym.make(WALKER, robot="cart", terrain="rough")


@pytest.mark.parametrize("options", [{"body": "footprint"}, {"terrain": "rough"}, {"v_max": 0.5}])
def test_elsewhere_a_robot_reserves_no_less_than_its_certificate(options):
    found = certificates.shipped()["cart"].margins
    reserved = gym.make(WALKER, robot="cart", **options).unwrapped.plant.uncertainty
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
    contract = plain(carts.FOLDER / "holonomic-cart.json")
    contract["mjcf"] = str(carts.FOLDER / contract["mjcf"])
    contract["policy"] = f"{__name__}:broken"
    sys.modules.setdefault(__name__, sys.modules[broken.__module__])
    path = tmp_path / "broken.json"
    path.write_text(json.dumps(contract))
    env = gym.make(WALKER, robot=str(path))
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

    env = gym.make(WALKER, robot=robot, scenario="random")
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


@pytest.mark.parametrize(
    ("scene", "v_max", "way"),
    [("paper-simulation", None, 0.0), ("paper-simulation", 0.5, 24.0), ("random", None, 40.0)],
)
def test_the_time_limit_follows_the_robots_speed(scene, v_max, way):
    given = {"robot": "holonomic-cart", "scenario": scene, "v_max": v_max}
    env = gym.make(WALKER, **given)
    fastest = env.unwrapped.fastest
    env.reset(seed=0)
    steps, truncated = 0, False
    while not truncated and steps < 10_000:
        truncated, steps = env.step(np.zeros(2))[3], steps + 1
    assert steps == pytest.approx(max(20.0, way / fastest) / 0.02, abs=1)
    assert gym.make(env.spec).spec == env.spec
    short = gym.make(WALKER, **given, max_episode_steps=7)
    short.reset(seed=0)
    assert [short.step(np.zeros(2))[3] for _ in range(7)] == [*[False] * 6, True]
    longer = gym.make(WALKER, **given, max_episode_steps=steps + 1)
    longer.reset(seed=0)
    assert not any(longer.step(np.zeros(2))[3] for _ in range(steps))
