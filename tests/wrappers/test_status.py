"""The report of a robot that is at rest inside a strict region."""

import warnings
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym.barriers import Disc
from hcbf_gym.models import DoubleIntegrator
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers import SafetyFilter
from tests.wrappers.point_mass import filtered, quietly


@pytest.mark.parametrize("solver", [None, "daqp"])
@pytest.mark.parametrize(
    ("body", "distance", "status"),
    [
        ("footprint", 0.3, FilterStatus.UNSAFE),
        ("footprint", 0.6, FilterStatus.NOMINAL),
        ("point", 0.3, FilterStatus.NOMINAL),
        ("point", -0.1, FilterStatus.UNSAFE),
    ],
)
def test_a_start_with_the_body_inside_a_strict_region_reports_outside(
    body, distance, status, solver
):
    env = gym.make("HCBF-A1Regions-v0", scenario="random-wide", body=body)
    env = SafetyFilter(env, program="lex-cbf-qp", solver=solver)
    env.reset(seed=1)
    wall = env.unwrapped.scenario.barriers[1]  # the right one, y ≥ offset
    start = (-1.0, wall.offset + distance)
    scene = replace(env.unwrapped.scenario, start=start)
    _, info = env.reset(seed=1, options={"scenario": scene})
    assert info["safety_filter"]["status"] == status
    _, _, _, _, info = env.step(np.zeros(2))
    assert (info["safety_filter"]["status"] == FilterStatus.UNSAFE) == (status == 4)


TRAP = {
    "name": "trap",
    "barriers": [
        {"kind": "half-plane", "name": "wall", "priority": 1, "normal": [-1.0, 0.0], "offset": -1.0}
    ],
    "reference": {"kind": "point", "goal": [3.0, 0.0]},
}


@pytest.mark.parametrize("solver", [None, "daqp"])
def test_a_plant_that_stands_though_the_policy_asks_is_deadlocked(solver):
    env = SafetyFilter(gym.make("HCBF-Regions-v0", scenario=TRAP), "lex-cbf-qp", solver=solver)
    _, info = env.reset(seed=0)
    assert info["safety_filter"]["deadlock"] == 0.0
    answers = []
    for _ in range(400):
        *_, info = env.step(np.array([1.0, 0.0], dtype=np.float32))
        answers.append(info["safety_filter"]["deadlock"])
    assert answers[10] == 0.0  # on its way
    assert answers[-1] == 1.0  # before the wall
    *_, info = env.step(np.array([0.1, 0.0], dtype=np.float32))
    assert info["safety_filter"]["deadlock"] == 0.0  # nothing is asked


@pytest.mark.parametrize("solver", [None, "daqp"])
@pytest.mark.parametrize("model", [DoubleIntegrator(), DoubleIntegrator(drag=0.5)])
@pytest.mark.parametrize(("body", "unsafe"), [(0.35, True), (0.25, False)])
def test_whichever_core_answers_the_body_counts(model, solver, body, unsafe):
    disc = Disc("near", 1, center=(0.8, 0.0), radius=0.5)  # .3 m away
    reserved = Uncertainty(body=body)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = filtered(listed=(disc,), model=model, uncertainty=reserved, solver=solver)
        env.reset(seed=0)
    status = quietly(env, np.zeros(2))["status"]
    assert (status == FilterStatus.UNSAFE) == unsafe
