"""Attackers: what they want, in which scenes, and one that a user adds."""

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import scenarios
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.evaluation import attacks
from hcbf_gym.evaluation.attacked import AttackedEpisode

EXAMPLE = Path(__file__).parents[2] / "examples" / "attacker.py"
NEAR = attacks.Surroundings(np.zeros(2), np.zeros(2), np.array([0.1]), np.array([[0.6, 0.8]]), 0.0)


@pytest.mark.parametrize("name", attacks.ATTACKS)
def test_an_attack_takes_an_input_to_its_limit_beside_one_region_alone(name):
    u = attacks.make(name, 0).act(NEAR)
    assert np.abs(u).max() == pytest.approx(attacks.FULL)


@pytest.mark.parametrize("name", ["nearest", "corner"])
def test_who_aims_at_the_nearest_region_goes_into_it(name):
    u = attacks.make(name, 0).act(NEAR)
    np.testing.assert_allclose(u / np.linalg.norm(u), -NEAR.normal[0], atol=1e-12)


def test_an_attack_is_decided_by_its_seed():
    wanted = [attacks.make("bang-bang", seed).act(NEAR).tolist() for seed in (*range(8), 3)]
    assert wanted[8] == wanted[3]
    assert len({tuple(u) for u in wanted}) > 1


def test_a_scene_without_a_strict_region_and_an_unknown_name_are_refused():
    scene = scenarios.make("paper-simulation").to_dict()
    scene["barriers"] = [{"kind": "speed-limit", "name": "cap", "priority": 1, "v_max": 1.0}]
    env = gym.make("HCBF-Regions-v0", scenario=scene)
    env.reset(seed=0)
    with pytest.raises(InvalidInputError, match="no strict barrier"):
        attacks.observe(env)
    with pytest.raises(UnknownNameError, match="slam"):
        attacks.make("stare", 0)


def test_an_attacker_of_ones_own_is_filtered_like_any_other(monkeypatch):
    monkeypatch.setattr(attacks, "ATTACKS", dict(attacks.ATTACKS))
    names: dict = {"__name__": "attacker"}
    exec(EXAMPLE.read_text(encoding="utf-8"), names)
    assert "circling" in attacks.ATTACKS
    assert 0.0 < names["least_distance"](range(3)) < 0.3


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A module of a user's own, which a name reaches."""
    lines = (
        "from hcbf_gym.evaluation.attacks import Attack",
        "class Away(Attack):",
        "    def act(self, s):",
        "        return 5.0 * s.normal[0]",
        "def away(s):",
        "    return 5.0 * s.normal[0]",
        "def wrong(s):",
        "    return [float('nan'), 0.0]",
        "number = 3",
    )
    (tmp_path / "own_attacks.py").write_text("\n".join(lines), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)


@pytest.mark.parametrize("name", ["own_attacks:Away", "own_attacks:away"])
def test_a_class_or_a_function_of_a_module_is_an_attack(own, name):
    np.testing.assert_array_equal(attacks.make(name, 0).act(NEAR), 5.0 * NEAR.normal[0])
    episode = AttackedEpisode(name, "random", 0, "HCBF-Regions-v0", {"max_episode_steps": 5})
    assert episode.run().least_h > 0.0


@pytest.mark.parametrize(
    ("name", "message"),
    [("own_attacks:none", "none"), ("nowhere:away", "nowhere"), ("own_attacks:number", "function")],
)
def test_what_a_module_does_not_have_is_refused(own, name, message):
    with pytest.raises(InvalidInputError, match=message):
        attacks.make(name, 0)


def test_an_invalid_input_is_refused(own):
    with pytest.raises(InvalidInputError, match="finite"):
        attacks.make("own_attacks:wrong", 0).act(NEAR)


def test_the_trained_attack_reads_what_is_shipped_and_depends_on_it():
    shipped = json.loads(attacks.TRAINED.read_text(encoding="utf-8"))
    assert "train_attack" in shipped["command"]
    parameters = tuple(shipped["parameters"])
    assert len(parameters) == attacks.N_TRAINED
    trained = attacks.make("trained", 3).act(NEAR)
    np.testing.assert_array_equal(attacks.make("trained", 3, parameters).act(NEAR), trained)
    turned = (*(-number for number in parameters[:18]), *parameters[18:])
    np.testing.assert_allclose(attacks.make("trained", 3, turned).act(NEAR), -trained)


def test_the_trained_attack_s_axes_turn_with_the_scene():
    """What a rotation by 90° does to the scene, it does to u*: the box |u_i| ≤ 5 turns, too."""
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    normal = np.array([[0.6, 0.8], [1.0, 0.0]])
    h, velocity = np.array([0.1, 0.4]), np.array([0.3, -0.2])
    here = attacks.Surroundings(np.zeros(2), velocity, h, normal, 0.7)
    there = attacks.Surroundings(np.zeros(2), turn @ velocity, h, normal @ turn.T, 0.7)
    straight, turned = (attacks.make("trained", 5).act(s) for s in (here, there))
    np.testing.assert_allclose(turned, turn @ straight, atol=1e-12)
