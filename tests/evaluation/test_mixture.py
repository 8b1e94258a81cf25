"""The A1's mixture: everything that is covered occurs, together, and a seed decides all of it."""

import json

import pytest

from hcbf_gym.errors import InvalidInputError
from hcbf_gym.estimation import sensors
from hcbf_gym.evaluation.attacks import ATTACKS
from hcbf_lab.certification import families
from hcbf_lab.certification.mixture import RANGES, SCENES, A1Mixture

MIXTURE = A1Mixture()
EPISODES = [MIXTURE.episode(seed) for seed in range(400)]


def declared(name):
    """Return what the episodes declare of one condition, those of no range."""
    drawn = [dict(episode.env_options or {})["randomization"].get(name) for episode in EPISODES]
    return [number for number in drawn if isinstance(number, float)]


def test_a_seed_decides_an_episode_and_what_is_written_down_draws_the_same():
    again = families.from_dict(json.loads(json.dumps(families.to_dict(MIXTURE))))
    assert again == MIXTURE
    assert [again.episode(seed) for seed in range(20)] == EPISODES[:20]
    short = A1Mixture(steps=10).episode(3)
    assert short.run() == short.run()


def test_everything_that_is_covered_occurs():
    options = [dict(episode.env_options or {}) for episode in EPISODES]
    assert {episode.attack for episode in EPISODES} == {*ATTACKS, "pd"}
    assert {episode.scenario["name"] for episode in EPISODES} == set(SCENES)
    assert {one["estimation"] for one in options} == {None, *sensors.PRESETS}
    assert {(one["terrain"], one["body"]) for one in options} == {
        (ground, body) for ground in ("flat", "rough") for body in ("point", "footprint")
    }
    assert any("guidance" in (episode.filter_options or {}) for episode in EPISODES)
    assert {1.5, 1.7} < {episode.scenario["v_max"] for episode in EPISODES}


@pytest.mark.parametrize("name", RANGES)
def test_every_condition_reaches_from_end_to_end_of_its_range(name):
    low, high = RANGES[name]
    numbers = declared(name)
    assert low <= min(numbers) < max(numbers) <= high
    assert max(numbers) - min(numbers) > 0.95 * (high - low)


def test_shares_are_those_that_are_written_down():
    ends = {"floor_friction": 0.4, "payload": 4.0, "motor_strength": 0.8, "delay": 0.008,
            "sensor_noise": 0.5}  # fmt: skip
    drawn = [dict(episode.env_options or {})["randomization"] for episode in EPISODES]
    extremes = [one for one in drawn if ends.items() <= one.items()]
    ranges = [one for one in drawn if one.get("delay") == list(RANGES["delay"])]
    assert 0.06 < len(extremes) / len(drawn) < 0.14
    assert 0.14 < len(ranges) / len(drawn) < 0.26
    assert any("10% have every condition" in sentence for sentence in MIXTURE.words)


def test_chances_that_make_no_sense_are_refused():
    for chances in ({"rough": 1.2}, {"extremes": 0.7, "ranges": 0.6}, {"end": float("nan")}):
        with pytest.raises(InvalidInputError, match="mixture: "):
            A1Mixture(**chances)
