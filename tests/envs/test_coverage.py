"""What is covered: one list, the page that shows it, and the warnings that follow from it."""

import re
import warnings
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from benchmarks.strict import lines
from hcbf_gym import models, scenarios
from hcbf_gym.envs import coverage
from hcbf_gym.errors import CoverageWarning
from hcbf_gym.evaluation.certification.mixture import A1Mixture
from hcbf_gym.filtering.core import FilterSettings
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.plant import Coverage, Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator

pytestmark = pytest.mark.usefixtures("fresh")

PAGE = Path(__file__).parents[2] / "docs" / "guarantees.md"


def made(**options):
    """Return the environment and the sentences that it warned with of what is not covered."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        env = gym.make("HCBF-A1Regions-v0", **{"scenario": "random"} | options).unwrapped
    return env, [str(one.message) for one in said if one.category is CoverageWarning]


SCENE = scenarios.make("random")
OUTSIDE = {
    "feedback": {"feedback": "measured"},
    "timestep": {"timestep": 0.01},
    "gait": {"gait": "stand"},
    "friction": {"friction": 2.0},
    "floor_friction": {"randomization": {"floor_friction": 0.15}},
    "payload ": {"randomization": {"payload": 6.0}},
    "payload_position": {"randomization": {"payload": 1.0, "payload_position": [0.2, 0.15, 0.1]}},
    "motor_strength": {"randomization": {"motor_strength": 0.7}},
    "delay": {"randomization": {"delay": 0.012}},
    "sensor_noise": {"randomization": {"sensor_noise": 1.5}},
    "disturbances": {"disturbances": {"kind": "random", "interval": 2.0, "impulse": [0.0, 6.0]}},
    "estimation": {"estimation": {"noise": 0.2}},
    "obstacles": {"scenario": "paper-experiment"},
    "input_set": {"scenario": replace(SCENE, input_set=Box.symmetric(0.5))},
    "v_max": {"scenario": replace(SCENE, v_max=0.45)},
    "alone": {"timestep": 0.005, "estimation": "lidar"},
    "alone ": {"friction": 0.5, "scenario": "paper-simulation"},
}


@pytest.mark.parametrize("argument", OUTSIDE)
def test_an_argument_outside_its_bound_is_named_once_with_the_bound(argument):
    env, said = made(**OUTSIDE[argument])
    assert env.covered == Coverage.OUTSIDE
    assert len(said) == 1
    assert re.search(rf"(: |; ){argument.strip()} ", said[0])
    assert "(tested: " in said[0]


@pytest.mark.parametrize("line", [line for line in lines.LINES if line.v_max is None], ids=str)
def test_what_the_strict_suite_tests_is_covered(line):
    for scenario in line.scenarios:
        env, said = made(scenario=scenario, **dict(line.env_options or {}))
        assert not said
        assert env.covered == Coverage.COVERED
        assert env.plant.covered(env, None, {}) == Coverage.COVERED


def test_every_plant_of_the_mixture_is_covered_and_what_it_declares_is_what_it_certifies():
    mixture = A1Mixture()
    for seed in range(12):
        episode = mixture.episode(seed)
        env, said = made(scenario=episode.scenario, **dict(episode.env_options or {}))
        assert not said
        assert env.covered == Coverage.SCENE  # its scenes are drawn beforehand, with a cap each
        certified = mixture.certifies(env.declared)
        assert {name: env.declared[name] for name in ("outside", "alone")} == {
            "outside": [],
            "alone": [],
        }
        assert certified["v_max"]["from"] <= env.declared["v_max"] <= certified["v_max"]["to"]
        env.close()


def test_the_family_of_the_scene_follows_the_episode():
    env, _ = made()
    env.reset(seed=0, options={"start": (0.1, 0.0)})
    assert env.covered == Coverage.SCENE
    env.reset(seed=0)
    assert env.covered == Coverage.COVERED
    env.change_scene(env.scenario)
    assert env.covered == Coverage.SCENE
    assert made(scenario="paper-simulation")[0].covered == Coverage.SCENE
    assert made(scenario=scenarios.make("random").to_dict())[0].covered == Coverage.SCENE


def test_the_native_batch_says_it_of_each_environment():
    env = gym.make_vec("HCBF-Regions-v0", num_envs=3, scenario="random").unwrapped
    env.reset(seed=0)
    assert (env.covered == Coverage.COVERED).all()
    mask = np.array([False, True, False])
    env.reset(options={"reset_mask": mask, "start": (0.1, 0.0)})
    np.testing.assert_array_equal(env.covered, np.where(mask, Coverage.SCENE, Coverage.COVERED))


def settings(**given):
    asked = {"rows": "held", "margin": None, "options": {}} | given
    return FilterSettings("lex-cbf-qp", guidance=None, solver=None, on_alarm=None,
                          allow_late_inputs=False, **asked)  # fmt: skip


def test_arguments_of_a_filter_that_leave_what_was_tested_are_named():
    a1 = made()[0].plant
    exact = gym.make("HCBF-Regions-v0", scenario="random").unwrapped.plant
    assert coverage.of_filter(settings(), a1) == []
    gentle = settings(options={"alpha1": {"kind": "log", "phi1": 0.8}, "alpha2": 1.0})
    assert coverage.of_filter(gentle, a1) == []
    for asked in (
        settings(rows="usual"),
        settings(margin=0.01),
        settings(options={"alpha2": 20.0}),
        settings(options={"alpha1": 2.0}),
    ):
        assert len(coverage.of_filter(asked, a1)) == 1
    assert coverage.of_filter(settings(margin=0.0), exact) == []
    assert coverage.of_filter(settings(rows="usual"), exact)
    foreign = Plant(DoubleIntegrator(), (), lambda *_: np.zeros(4))
    assert coverage.of_filter(settings(rows="usual"), foreign) == []
    heavy = settings(options={"alpha1": 100.0})
    unicycle = replace(exact, model=models.Unicycle())
    assert coverage.of_filter(heavy, exact) == []
    assert coverage.of_filter(heavy, unicycle)


def test_the_page_shows_the_list():
    page = PAGE.read_text(encoding="utf-8")
    begin, end = "<!-- coverage: envs/coverage.py -->", "<!-- end of coverage -->"
    shown = page[page.index(begin) + len(begin) : page.index(end)].strip()
    assert shown == coverage.table()
