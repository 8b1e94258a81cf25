"""A reader that raises at the first reset raises to the user; later it brakes."""

import dataclasses

import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

import hcbf_gym
from hcbf_gym import models
from hcbf_gym.barriers import Disc
from hcbf_gym.errors import SafetyWarning
from hcbf_gym.models import Coverage, Reason
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter
from tests.worlds import World

N, T = 3, 0.05
DISC = [Disc("pillar", 1, center=(3.0, 0.0), radius=0.5)]
REASONS = {
    "state": Reason.STATE,
    "barriers": Reason.BARRIERS,
    "goal": Reason.GOAL,
    "extent": Reason.GOAL,
    "covered": Reason.NONE,
}


class Sensor:
    """Readers of a plant, of which one may raise."""

    def __init__(self, many):
        self.raises, shape = "", (N, 4) if many else (4,)
        values = {
            "state": np.zeros(shape), "barriers": DISC, "goal": np.array([1.5, 1.0]),
            "extent": ((-5.0, -5.0), (5.0, 5.0)), "covered": Coverage.OUTSIDE,
        }  # fmt: skip
        readers = {name: self._reader(name, value) for name, value in values.items()}
        self.plant = hcbf_gym.Plant(models.DoubleIntegrator(), period=T, **readers)

    def _reader(self, name, value):
        def read(env, observation, info):
            if self.raises == name:
                raise KeyError(f"no {name}")
            return value

        return read


def robots():
    return SyncVectorEnv([lambda: World(limit=2.0)] * N)


@pytest.mark.parametrize("name", REASONS)
@pytest.mark.parametrize("many", [False, True])
def test_every_reader_raises_at_the_first_reset_and_brakes_later(many, name):
    sensor = Sensor(many)
    wrap, env = (VectorSafetyFilter, robots()) if many else (SafetyFilter, World(limit=2.0))
    safe = wrap(env, plant=sensor.plant, guidance="geodesic")
    action = np.zeros((N, 2)) if many else np.zeros(2)
    sensor.raises = name
    for _ in range(2):  # one that failed was not the first
        with pytest.raises(KeyError, match=f"no {name}") as raised:
            safe.reset()
        assert f"reader of the {name}" in raised.value.__notes__[0]
    sensor.raises = ""
    safe.reset()
    safe.step(action)
    sensor.raises = name
    with pytest.warns(SafetyWarning) as warned:
        info = safe.step(action)[4]
    assert np.all(info["safety_filter"]["reason"] == REASONS[name])
    _, info = safe.reset()
    answers = [str(one.message) for one in warned]
    assert sum(f"reader of the {name} raised KeyError" in one for one in answers) == 1
    assert np.all(info["safety_filter"]["reason"] == REASONS[name])
    assert not np.any(info["safety_filter"]["covered"])
    sensor.raises = ""
    safe.reset()
    assert not np.any(safe.step(action)[4]["safety_filter"]["reason"])


@pytest.mark.parametrize("many", [False, True])
def test_covered_is_read_at_every_step_and_ends_within_an_episode(many):
    answers = [Coverage.COVERED]
    sensor = Sensor(many)
    plant = dataclasses.replace(sensor.plant, covered=lambda *_: answers[0])
    wrap, env = (VectorSafetyFilter, robots()) if many else (SafetyFilter, World(limit=2.0))
    safe = wrap(env, plant=plant)
    action = np.zeros((N, 2)) if many else np.zeros(2)
    _, info = safe.reset()
    began = np.unique(info["safety_filter"]["covered"]).tolist()
    found = []
    for now in (Coverage.COVERED, Coverage.OUTSIDE, Coverage.COVERED):
        answers[0] = now
        found.append(np.unique(safe.step(action)[4]["safety_filter"]["covered"]).tolist())
    assert found == [began, [Coverage.OUTSIDE], [Coverage.OUTSIDE]]
    assert np.unique(safe.reset()[1]["safety_filter"]["covered"]).tolist() == began
