"""The strict study: what it counts."""

import gymnasium as gym
import numpy as np
import pytest

from benchmarks.strict import lines, pushed
from hcbf_gym.evaluation import attacks
from hcbf_gym.evaluation.attacked import AttackedEpisode


def test_calm_seeds_are_those_whose_environment_starts_in_no_region():
    env = gym.make("HCBF-A1Regions-v0", scenario="random")
    calm = lines.seeds("random", 5, calm=True)
    every = range(lines.FIRST_SEED["random"], calm[-1] + 1)
    free = [seed for seed in every if (env.reset(seed=seed)[1]["h"] >= 0.0).all()]
    assert calm == free
    assert len(calm) < len(every)


def test_every_line_has_three_hundred_episodes():
    counts = {(line.section, line.name): len(line.episodes(quick=False)) for line in lines.LINES}
    assert {name for section, name in counts if section == "nominal"} == set(attacks.ATTACKS)
    assert {name for section, name in counts if section == "plant"} == set(lines.PLANTS)
    assert min(counts.values()) >= 300
    assert len(pushed.PROGRAMS) * len(pushed.POLICIES) * pushed.SEEDS >= 200


def test_a_faster_scene_is_the_environment_s_own_but_for_its_cap():
    own = gym.make("HCBF-A1Regions-v0", scenario="random")
    own.reset(seed=3)
    faster = gym.make("HCBF-A1Regions-v0", scenario=lines.faster("random", 3, 1.7))
    faster.reset(seed=3)
    assert faster.unwrapped.scenario.v_max == 1.7
    assert faster.unwrapped.scenario.barriers == own.unwrapped.scenario.barriers
    np.testing.assert_array_equal(faster.unwrapped.truth, own.unwrapped.truth)


@pytest.mark.physics
def test_the_least_h_of_the_body_is_that_of_all_steps_and_strict_regions_alone():
    options = {"body": "footprint", "max_episode_steps": 100}
    outcome = AttackedEpisode("nearest", "random", 0, env_options=options).run()
    declared = gym.make("HCBF-A1Regions-v0", scenario="random", body="footprint").unwrapped
    assert outcome.reach <= declared.plant.uncertainty.body
    assert 0.0 < outcome.least_h - outcome.least_body_h <= outcome.reach
    assert outcome.least_body_h > 0.0
    assert outcome.nees is None


@pytest.mark.physics
def test_an_estimate_s_error_and_consistency_are_reported():
    options = {"estimation": {}, "max_episode_steps": 100}
    outcome = AttackedEpisode("nearest", "random", 0, env_options=options).run()
    assert outcome.position_error is not None
    assert outcome.nees is not None
    assert outcome.nees_inside is not None
    assert 0.001 < outcome.position_error < 0.03
    assert 0.5 < outcome.nees < 20.0
    assert outcome.nees_inside > 0.5


@pytest.mark.physics
def test_a_robot_pushed_into_a_strict_region_reports_it_and_comes_out():
    outcome = pushed.PushedEpisode("lex-cbf-qp", "pd", 1).run()
    assert outcome.near <= pushed.NEAR
    assert outcome.inside > 0
    assert outcome.reported == outcome.inside
    assert outcome.depth > 0.0
    assert outcome.seconds <= pushed.OUT_WITHIN
    assert not outcome.fell


def test_late_exits_unreported_steps_and_falls_are_counted():
    good = pushed.PushedOutcome(0.1, 0.3, inside=50, reported=50, seconds=1.0, fell=False)
    bad = pushed.PushedOutcome(0.1, 0.9, inside=150, reported=149, seconds=3.0, fell=True)
    row = pushed.summary([good, bad])
    assert (row["entered"], row["late"], row["falls"]) == (2, 1, 1)
    assert (row["steps_inside"], row["told"]) == (200, 199)
    np.testing.assert_allclose((row["deepest"], row["longest"], row["median"]), (0.9, 3.0, 2.0))
