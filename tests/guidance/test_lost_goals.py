"""A goal that guidance cannot reach brakes with its reason; one that moves is followed."""

from contextlib import nullcontext

import gymnasium as gym
import numpy as np
import pytest

import hcbf_gym
from hcbf_gym import Estimate, _core, models
from hcbf_gym.barriers import Disc, SpeedLimit
from hcbf_gym.errors import InvalidInputError, SafetyWarning
from hcbf_gym.models import Box, Reason
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter
from hcbf_robots import Command, Robot, VelocityFilter
from hcbf_robots.maps import Grid, MapClass, RankedMap
from tests.worlds import World

T, START, GOAL = 0.05, (1.0, 1.0), (5.0, 1.0)
REMEDY = 'guidance={"kind": "geodesic", "through": 2}'
GUIDED = {"geodesic": "geodesic", "remedy": {"kind": "geodesic", "through": 2}}


def a_map(zone=True):
    """A room of 6 m by 2 m, its middle crossed by a zone of rank 2."""
    walls, lawn = np.zeros((2, 40, 120), dtype=bool)
    walls[[0, -1]], walls[:, [0, -1]] = True, True
    lawn[:, 50:60] = zone
    classes = (MapClass("walls", 1, "keepout", walls), MapClass("lawn", 2, "keepout", lawn))
    return RankedMap(Grid(0.05, (0.0, 0.0, 0.0), walls.shape), classes[: 1 + zone])


class Room(World):
    """A planar double integrator whose goal and barriers are readers of it."""

    def __init__(self, ranked=None, goal=GOAL, start=START):
        super().__init__(period=T, limit=2.0, start=[*start, 0.5, 0.0])
        self.barriers = [*(ranked.conditions if ranked else ()), SpeedLimit("cap", 1, 1.0)]
        self.goal = goal

    @property
    def plant(self):
        return hcbf_gym.Plant(
            models.DoubleIntegrator(), lambda env, *_: env.barriers,
            lambda env, *_: Estimate(env.x.copy()), period=T, goal=lambda env, *_: env.goal,
        )  # fmt: skip


def by_wrapper(ranked, led, goal=GOAL):
    env = SafetyFilter(Room(ranked, goal), guidance=led)
    env.reset()
    return [env.step(np.zeros(2))[4]["safety_filter"] for _ in range(30)]


def by_batch(ranked, led, goal=GOAL):
    filt = hcbf_gym.BatchFilter(Box.symmetric(2.0), T, 2, guidance=led)
    cap = SpeedLimit("cap", 1, 1.0)
    filt.set_scene([[*a_map(zone=False).conditions, cap], [*ranked.conditions, cap]])
    x = np.tile([*START, 0.5, 0.0], (2, 1))
    filt.reset(x=x, goal=np.array([GOAL, goal]))
    reports = []
    for _ in range(30):
        u, report = filt(np.zeros((2, 2)), x)
        x = x + T * np.hstack([x[:, 2:] + 0.5 * T * u, u])
        assert report["reason"][0] == Reason.NONE
        reports.append({key: value[1] for key, value in report.items()})
    return reports


def by_velocity(ranked, led, goal=GOAL):
    robot = Robot(Command(0.8, 1.5, 0.8), reach=0.2)
    safe = VelocityFilter(robot, ranked.conditions, period=T, goal=goal, guidance=led)
    pose, commanded, reports = np.array([*START, 0.0]), np.zeros(3), []
    for k in range(30):
        commanded, report = safe.step((0.3, 0.0, 0.0), pose, commanded, k * T)
        pose = pose + T * commanded
        reports.append(report)
        if report["reason"] == Reason.GOAL:
            assert (commanded == 0.0).all()
    return reports


ENTRIES = {"wrapper": by_wrapper, "batch": by_batch, "velocity": by_velocity}


@pytest.mark.parametrize("entry", ENTRIES)
def test_a_goal_behind_a_zone_brakes_with_its_reason_and_the_remedy_reaches_it(entry):
    with pytest.warns(SafetyWarning) as warned:
        reports = ENTRIES[entry](a_map(), "geodesic")
    assert any(REMEDY in str(one.message) for one in warned)
    assert {int(report["reason"]) for report in reports} == {Reason.GOAL}
    assert {int(report["status"]) for report in reports} == {FilterStatus.BACKUP}
    for report in reports:
        assert not np.isnan(report["h"]).any()  # infinite where nothing of the map is near
        assert entry == "velocity" or np.isfinite(report["h"][-1])
    if entry != "velocity":
        assert np.linalg.norm(reports[-1]["u_safe"]) < 1e-6  # it is at rest
    assert {int(one["reason"]) for one in ENTRIES[entry](a_map(), GUIDED["remedy"])} == {0}


@pytest.mark.parametrize("entry", ENTRIES)
@pytest.mark.parametrize("goal", [(0.01, 1.0), (9.0, 1.0)], ids=["in a wall", "off the map"])
def test_a_goal_where_nothing_can_be_brakes_with_its_reason(entry, goal):
    with pytest.warns(SafetyWarning, match=r"no path to the goal \(goal: got"):
        reports = ENTRIES[entry](a_map(zone=False), "geodesic", goal)
    assert {int(report["reason"]) for report in reports} == {Reason.GOAL}
    assert not any(np.isnan(report["h"]).any() for report in reports)


def test_it_brakes_within_the_safety_rows():
    """The braking input is filtered: a robot beside a wall is not pressed into it."""
    env = Room(a_map(), start=(1.0, 0.25))
    safe = SafetyFilter(env, guidance="geodesic")
    with pytest.warns(SafetyWarning):
        safe.reset()
    env.x[2:] = 0.3, -0.4
    for _ in range(40):
        report = safe.step(np.array([0.0, -2.0]))[4]["safety_filter"]
        assert report["reason"] == Reason.GOAL
        assert report["h"][0] > -1e-9
    np.testing.assert_allclose(env.x[2:], 0.0, atol=1e-3)


def test_a_way_that_opens_and_a_goal_that_moves_end_it():
    env = Room(a_map())
    safe = SafetyFilter(env, guidance="geodesic")
    with pytest.warns(SafetyWarning):
        safe.reset()
    assert safe.step(np.zeros(2))[4]["safety_filter"]["reason"] == Reason.GOAL
    env.goal = (1.5, 1.2)
    assert safe.step(np.zeros(2))[4]["safety_filter"]["reason"] == Reason.NONE
    env.goal = GOAL
    assert safe.step(np.zeros(2))[4]["safety_filter"]["reason"] == Reason.GOAL
    env.barriers = [*a_map(zone=False).conditions, SpeedLimit("cap", 1, 1.0)]
    reasons = [int(safe.step(np.zeros(2))[4]["safety_filter"]["reason"]) for _ in range(12)]
    assert reasons[-1] == Reason.NONE


def test_an_alarm_does_not_hide_it():
    class Alarmed(Room):
        @property
        def plant(self):
            plant = super().plant
            fault = Estimate(None, fault=Reason.SLIP).fault
            return hcbf_gym.Plant(
                plant.model, plant.barriers, lambda env, *_: Estimate(env.x.copy(), fault=fault),
                period=T, goal=GOAL,
            )  # fmt: skip

    safe = SafetyFilter(Alarmed(a_map()), guidance="geodesic")
    with pytest.warns(SafetyWarning):
        safe.reset()
    report = safe.step(np.array([1.0, 0.0]))[4]["safety_filter"]
    assert report["status"] == FilterStatus.BACKUP
    assert report["reason"] == Reason.GOAL


# -- goals that move ------------------------------------------------------------------------------


@pytest.fixture
def computed(monkeypatch):
    """The goals for which fields were computed."""
    calls = []
    solve = _core.solve_field

    def counted(*args):
        calls.append(args[3].copy())
        return solve(*args)

    monkeypatch.setattr(_core, "solve_field", counted)
    return calls


DISC = [Disc("pillar", 1, center=(3.0, 0.5), radius=0.4), SpeedLimit("cap", 1, 1.0)]


def chase(entry, goals):
    """Drive with a policy that wants to be at rest; return where the robot is in the end."""
    if entry == "wrapper":
        env = Room(start=(0.0, 0.5), goal=goals[0])
        env.barriers = DISC
        safe = SafetyFilter(env, guidance="geodesic")
        safe.reset()
        for goal in goals:
            env.goal = goal
            safe.step(np.clip(-1.5 * env.x[2:], -2.0, 2.0))
        return env.x[:2]
    filt = hcbf_gym.BatchFilter(Box.symmetric(2.0), T, 2, guidance="geodesic")
    filt.set_scene(DISC)
    x = np.tile([0.0, 0.5, 0.0, 0.0], (2, 1))
    filt.reset(x=x, goal=goals[0])
    for goal in goals:
        filt.goal = np.array([goals[0], goal])
        u, _ = filt(-1.5 * x[:, 2:], x)
        x = x + T * np.hstack([x[:, 2:] + 0.5 * T * u, u])
    return x[1, :2]


@pytest.mark.parametrize("entry", ["wrapper", "batch"])
def test_a_goal_that_moves_is_followed_with_a_field_for_each_cell(entry, computed):
    still = [(6.0, 0.5)] * 20
    small = [(6.0, 0.5 + 0.004 * k) for k in range(20)]  # less than a cell
    moved = [(6.0, 2.5)] * 400
    end = chase(entry, still + small + moved)
    assert len(computed) == 2  # at the reset, and when it moved by more than a cell
    np.testing.assert_allclose(computed[-1], (6.0, 2.5))
    np.testing.assert_allclose(end, (6.0, 2.5), atol=0.05)


@pytest.mark.parametrize("entry", ["wrapper", "batch"])
def test_a_goal_that_moves_by_less_than_a_cell_is_where_the_robot_arrives(entry, computed):
    end = chase(entry, [(1.5, 0.5)] * 5 + [(1.56, 0.5)] * 300)
    assert len(computed) == 1
    np.testing.assert_allclose(end, (1.56, 0.5), atol=0.02)


def test_a_field_is_computed_once_a_step_at_most(computed):
    chase("wrapper", [(6.0, 0.5 + 0.5 * k) for k in range(10)])
    assert len(computed) == 10


def test_a_native_vector_follows_its_goals(computed):
    scene = {
        "name": "open",
        "barriers": [
            {"kind": "disc", "name": "d", "priority": 1, "center": [3.0, -2.0], "radius": 0.5}
        ],
        "reference": {"kind": "point", "goal": [3.0, 0.0]},
        "start": [0.0, 0.0],
    }
    envs = gym.make_vec("HCBF-Regions-v0", num_envs=2, scenario=scene)
    safe = VectorSafetyFilter(envs, guidance="geodesic")
    safe.reset(seed=0)
    envs.unwrapped._batch.separate()
    for k in range(3):
        safe.step(np.zeros((2, 2), dtype=np.float32))
        envs.unwrapped._batch._references.tables[1, :, 1] = 0.5 * (k + 1)
    assert [aim.tolist() for aim in computed] == [[3.0, 0.0], [3.0, 0.5], [3.0, 1.0]]


def test_a_goal_without_numbers_is_refused_at_the_first_reset_and_brakes_later():
    env = Room(goal=None)
    safe = SafetyFilter(env, guidance="geodesic")
    with pytest.raises(InvalidInputError, match="goal: got None"):
        safe.reset()
    env.goal = (2.0, 1.0)
    safe.reset()
    for lost in (None, "there", (np.nan, 1.0), (1.0, 2.0, 3.0)):
        env.goal = lost
        with pytest.warns(SafetyWarning) if lost is None else nullcontext():
            report = safe.step(np.zeros(2))[4]["safety_filter"]
        assert report["reason"] == Reason.GOAL
        env.goal = (2.0, 1.0)
        assert safe.step(np.zeros(2))[4]["safety_filter"]["reason"] == Reason.NONE


def test_nothing_but_a_guided_filter_reads_goals():
    reads = []

    class Counted(Room):
        @property
        def plant(self):
            plant = super().plant
            return hcbf_gym.Plant(
                plant.model, plant.barriers, plant.state, period=T,
                goal=lambda env, *_: reads.append(1) or GOAL,
            )  # fmt: skip

    for led, expected in ((None, 0), ("geodesic", 4)):
        safe = SafetyFilter(Counted(), guidance=led)
        safe.reset()
        for _ in range(3):
            safe.step(np.zeros(2))
        assert len(reads) == expected
