"""Attackers: what they want, in which scenes, and one that a user adds."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import scenarios
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.evaluation import attacks

EXAMPLE = Path(__file__).parents[2] / "examples" / "attacker.py"
NEAR = attacks.Surroundings(np.zeros(2), np.zeros(2), np.array([0.1]), np.array([[0.6, 0.8]]), 0.0)


@pytest.mark.parametrize("name", attacks.ATTACKS)
def test_an_attack_takes_an_input_to_its_limit_beside_one_region_alone(name):
    u = attacks.make(name, 0).wants(NEAR)
    assert np.abs(u).max() == pytest.approx(attacks.FULL)


@pytest.mark.parametrize("name", ["nearest", "corner"])
def test_who_aims_at_the_nearest_region_goes_into_it(name):
    u = attacks.make(name, 0).wants(NEAR)
    np.testing.assert_allclose(u / np.linalg.norm(u), -NEAR.normal[0], atol=1e-12)


def test_an_attack_is_decided_by_its_seed():
    wanted = [attacks.make("bang-bang", seed).wants(NEAR).tolist() for seed in (*range(8), 3)]
    assert wanted[8] == wanted[3]
    assert len({tuple(u) for u in wanted}) > 1


def test_a_scene_without_a_strict_region_and_an_unknown_name_are_refused():
    scene = scenarios.make("paper-simulation").to_dict()
    scene["barriers"] = [{"kind": "speed-limit", "name": "cap", "priority": 1, "v_max": 1.0}]
    env = gym.make("HCBF-Regions-v0", scenario=scene)
    env.reset(seed=0)
    with pytest.raises(InvalidInputError, match="no strict barrier"):
        attacks.look(env)
    with pytest.raises(UnknownNameError, match="slam"):
        attacks.make("stare", 0)


def test_an_attacker_of_ones_own_is_filtered_like_any_other(monkeypatch):
    monkeypatch.setattr(attacks, "ATTACKS", dict(attacks.ATTACKS))
    names: dict = {"__name__": "attacker"}
    exec(EXAMPLE.read_text(encoding="utf-8"), names)
    assert "circling" in attacks.ATTACKS
    assert 0.0 < names["least_distance"](range(3)) < 0.3
