"""What is reported of a step, from every core, and that a robot stops where U can stop it."""

import warnings
from dataclasses import dataclass, replace

import gymnasium as gym
import numpy as np
import pytest

import hcbf_gym  # noqa: F401 - registers the environments
from hcbf_gym.barriers import Disc, HalfPlane, PlanarBarrier
from hcbf_gym.filter import bound
from hcbf_gym.models import DoubleIntegrator, Uncertainty
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter
from tests.worlds import OwnDisc
from tests.wrappers.point_mass import AHEAD, filtered, quietly


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


U = np.array([1.0, 0.5])


def paper(solver=None):
    env = gym.make("HCBF-Regions-v0", scenario="paper-simulation")
    return SafetyFilter(env, solver=solver)


@pytest.mark.parametrize("solver", [None, "daqp"])
def test_one_plant_reports_every_field_as_an_array_or_a_scalar_of_numpy(solver):
    env = paper(solver)
    _, at_reset = env.reset(seed=0)
    *_, at_step = env.step(U)
    for reported in (at_reset["safety_filter"], at_step["safety_filter"]):
        assert {*(bound.report_dtype(2).names or ()), *(bound.ROW.names or ())} <= set(reported)
        for name in bound.report_dtype(2).names or ():
            kind = bound.report_dtype(2)[name]
            assert np.shape(reported[name]) == kind.shape
            assert np.asarray(reported[name]).dtype == kind.base
            assert isinstance(reported[name], np.ndarray | np.generic)
        for name in bound.ROW.names or ():
            assert reported[name].shape == reported["slack"].shape


def test_a_report_is_not_changed_by_the_next_step():
    envs = VectorSafetyFilter(gym.make_vec("HCBF-Regions-v0", num_envs=2))
    for env, u in ((paper(), U), (envs, np.tile(U, (2, 1)))):
        env.reset(seed=0)
        *_, info = env.step(u)
        reported = info["safety_filter"]
        before = {name: np.array(value) for name, value in reported.items()}
        for _ in range(3):
            env.step(-3.0 * u)
        for name, value in before.items():
            assert np.array_equal(reported[name], value)


WALL = HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-2.0)


@dataclass(frozen=True)
class OwnWall(PlanarBarrier):
    """A wall without a core."""

    name: str = "own wall"
    priority: int = 1

    def planar_jet(self, q):
        return 2.0 - q[0], np.array([-1.0, 0.0]), np.zeros((2, 2))


CORES = {
    "compiled": {},
    "daqp": {"solver": "daqp"},
    "another model": {"model": DoubleIntegrator(drag=0.1)},
}


@pytest.mark.parametrize("wall", [WALL, OwnWall()], ids=["shape", "own"])
@pytest.mark.parametrize("core", CORES)
def test_a_robot_that_can_still_stop_before_a_wall_does(core, wall):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = filtered(listed=(wall,), **CORES[core])
        env.reset(seed=0)
        env.unwrapped.x = np.array([1.6, 0.0, 1.9, 0.0])  # .361 m of .4 m stop it
        quietly(env, np.zeros(2))  # this state is news
    least = min((quietly(env, AHEAD), 2.0 - env.unwrapped.x[0])[1] for _ in range(150))
    assert least >= -1e-6


def test_a_condition_without_a_core_keeps_what_h_dips_between_two_samples():
    env = filtered(listed=(OwnDisc("own disc", 1, (2.0, 0.0)),), period=0.02)
    env.reset(seed=0)
    env.unwrapped.x = np.zeros(4)
    least = np.inf
    for _ in range(300):
        before = env.unwrapped.x.copy()
        report = quietly(env, AHEAD)
        u = report["u_safe"]
        for part in np.linspace(0.0, 0.02, 11):
            at = before[:2] + part * before[2:] + 0.5 * part**2 * u
            least = min(least, float(np.hypot(at[0] - 2.0, at[1]) - 0.5))
    assert 0.0 <= least < 0.05
    assert report["margin"][0] >= 0.499 * np.hypot(5.0, 5.0) * 0.02**2
