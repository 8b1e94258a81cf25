"""What is covered of the package's environments, the page that shows it, and the warnings."""

import re
import warnings
from dataclasses import asdict, replace

import gymnasium as gym
import numpy as np
import pytest

from benchmarks.strict import lines
from hcbf_gym import Plant, certificates, models, scenarios
from hcbf_gym.certificates import judge
from hcbf_gym.errors import CoverageWarning
from hcbf_gym.estimation import sensors
from hcbf_gym.filter.certified import judge_filter
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models import Box, Coverage, CoveredBy, DoubleIntegrator
from hcbf_lab.certification.mixture import A1Mixture

pytestmark = pytest.mark.usefixtures("released")


def made(**options):
    """Return the environment and its warnings of missing coverage."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        env = gym.make("HCBF-A1Regions-v0", **{"scenario": "random"} | options).unwrapped
    return env, [str(one.message) for one in caught if one.category is CoverageWarning]


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
    env, warned = made(**OUTSIDE[argument])
    assert (env.judged.covered, env.judged.covered_by) == (Coverage.OUTSIDE, CoveredBy.ARGUMENT)
    assert len(warned) == 1
    assert re.search(rf"(: |; ){argument.strip()} ", warned[0])
    assert "(tested: " in warned[0]


@pytest.mark.parametrize("line", [line for line in lines.LINES if line.v_max is None], ids=str)
def test_what_the_strict_suite_tests_is_covered(line):
    for scenario in line.scenarios:
        env, warned = made(scenario=scenario, **dict(line.env_options or {}))
        assert not warned
        assert env.judged.covered == Coverage.COVERED
        assert env.plant.covered(env, None, {}) == (Coverage.COVERED, CoveredBy.NONE, ())


def test_every_plant_of_the_mixture_is_covered_and_what_it_declares_is_what_it_certifies():
    mixture = A1Mixture()
    for seed in range(12):
        episode = mixture.episode(seed)
        env, warned = made(scenario=episode.scenario, **dict(episode.env_options or {}))
        assert not warned
        judged = env.judged
        assert judged.covered == Coverage.SCENE  # its scenes are drawn beforehand, with a cap each
        certified = mixture.certifies(env.declared)
        assert not judge(env.declared, certified).reasons
        assert certificates.shipped()["a1-mixture"].plant == certified
        env.close()


def test_the_family_of_the_scene_follows_the_episode():
    env, _ = made()
    env.reset(seed=0, options={"start": (0.1, 0.0)})
    assert env.judged.covered == Coverage.SCENE
    env.reset(seed=0)
    assert env.judged.covered == Coverage.COVERED
    env.change_scene(env.scenario)
    assert env.judged.covered == Coverage.SCENE
    assert made(scenario="paper-simulation")[0].judged.covered == Coverage.SCENE
    assert made(scenario=scenarios.make("random").to_dict())[0].judged.covered == Coverage.SCENE


def test_the_native_batch_reports_it_of_each_environment():
    env = gym.make_vec("HCBF-Regions-v0", num_envs=3, scenario="random").unwrapped
    env.reset(seed=0)
    assert (env.judged.covered == Coverage.COVERED).all()
    mask = np.array([False, True, False])
    env.reset(options={"reset_mask": mask, "start": (0.1, 0.0)})
    expected = np.where(mask, Coverage.SCENE, Coverage.COVERED)
    np.testing.assert_array_equal(env.judged.covered, expected)


def settings(**given):
    asked = {"rows": "held", "margin": None, "options": {}} | given
    return FilterSettings("lex-cbf-qp", guidance=None, solver=None, on_alarm=None,
                          allow_late_inputs=False, **asked)  # fmt: skip


def outside(asked, plant, certificate=None):
    """Return what of a filter's arguments lies outside."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CoverageWarning)
        found = judge_filter(asked, plant, [], certificate)
    assert found is None or (found.covered, found.covered_by) == (0, CoveredBy.FILTER)
    return () if found is None else found.reasons


def test_arguments_of_a_filter_that_leave_what_was_tested_are_named():
    a1 = made()[0].plant
    exact = gym.make("HCBF-Regions-v0", scenario="random").unwrapped.plant
    assert not outside(settings(), a1)
    gentle = settings(options={"alpha1": {"kind": "log", "phi1": 0.8}, "alpha2": 1.0})
    assert not outside(gentle, a1)
    steep = settings(options={"alpha2": 10.0, "alpha_speed": 10.0})
    assert len(outside(steep, replace(a1, uncertainty=models.Uncertainty(distance=0.1)))) == 2
    for asked in (
        settings(rows="usual"),
        settings(margin=0.01),
        settings(options={"alpha2": 2.1}),
        settings(options={"alpha_speed": 2.1}),
        settings(options={"alpha1": 2.0}),
    ):
        assert len(outside(asked, a1)) == 1
    assert not outside(settings(margin=0.0), exact)
    assert outside(settings(rows="usual"), exact)
    foreign = Plant(DoubleIntegrator(), (), lambda *_: np.zeros(4))
    assert not outside(settings(rows="usual"), foreign)
    heavy = settings(options={"alpha1": 100.0})
    unicycle = replace(exact, model=models.Unicycle())
    assert not outside(heavy, exact)
    assert outside(heavy, unicycle)
    assert outside(settings(), exact, certificates.load("regions")) == ()
    cbf = settings()._replace(program="cbf-qp")
    assert len(outside(cbf, exact, certificates.load("regions"))) == 1


def test_the_worst_sensors_that_are_covered_are_the_worst_preset():
    ranges = certificates.shipped()["a1-mixture"].plant["estimation"]["any of"][1]["each"]
    worst = {name: next(iter(one.values())) for name, one in ranges.items()}
    assert worst == asdict(sensors.PRESETS["uwb"])
