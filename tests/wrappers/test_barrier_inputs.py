"""Filters fail closed: barriers as a sequence or from a reader, every core, every fault.

Elements other than single barriers, and the package's environment, are in front of the compiled
cores alone. `why_not` names what has no meaning.
"""

import functools

import numpy as np
import pytest
from barrier_inputs import (
    AHEAD,
    CALM,
    FAR,
    INPUTS,
    Batched,
    Changed,
    Driven,
    Scene,
    Single,
    T,
    Truth,
    quietly,
)  # fmt: skip

from hcbf_gym import models
from hcbf_gym.barriers import Disc, SpeedLimit
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models import Reason
from hcbf_gym.programs import FilterStatus
from tests.pairs import pairwise
from tests.worlds import OwnLinear

CORES = ("compiled", "daqp", "clarabel", "drag", "no period", "vector", "velocity filter")


def filter_of(name, core, world, **options):
    """The filter of a core with an input, around a world."""
    kind = Changed if name == "change_scene" else Single
    match core:
        case "vector":
            kind = Batched
        case "velocity filter":
            kind = Driven
        case "no period":
            options |= {"period": None}
        case "daqp" | "clarabel":
            options |= {"solver": core}
    return quietly(functools.partial(kind, **options), name, world)


def world_of(core, **fields):
    drag = {"model": models.DoubleIntegrator(drag=0.1)} if core == "drag" else {}
    return Truth(**drag, **fields)


class Run:
    """An episode, judged at every step."""

    def __init__(self, name, core, **options):
        self.core = core
        self.world = world_of(core)
        self.filter = filter_of(name, core, self.world, **options)
        self.entries = self.unreported = 0
        quietly(self.filter.reset)

    def step(self, u=AHEAD):
        report = quietly(self.filter.step, u)
        status = report["status"]
        self.entries += self.world.entered
        self.unreported += self.world.entered and status < CALM
        assert np.isfinite(report["u_safe"]).all()
        if self.core != "velocity filter":  # whose margins may be consumed
            assert report["proved"] == (status < CALM) or status >= CALM
        assert not (self.unreported), f"entered under {FilterStatus(status).name}"
        return report

    def steps(self, count, u=AHEAD):
        return [self.step(u) for _ in range(count)]


def of_state(change, *reasons):
    """A fault of the sensors: the filter brakes while it lasts, with a reason, and continues."""

    def happens(name, core):
        run = Run(name, core)
        run.steps(10)
        run.world.lie = change
        for _ in range(5):
            before = run.world.x[2]
            report = run.step()
            assert report["status"] == FilterStatus.BACKUP
            assert report["reason"] in reasons
            assert run.world.x[2] < before or core == "no period" or before <= 1e-9
        run.world.lie = None
        assert [report["status"] < FilterStatus.BACKUP for report in run.steps(3)][-1]

    return happens


def raises(name, core):
    run = Run(name, core)
    run.steps(10)
    run.world.raises = True
    assert all(report["status"] == FilterStatus.BACKUP for report in run.steps(5))
    run.world.raises = False
    assert run.steps(2)[-1]["status"] < FilterStatus.BACKUP


def of_barriers(*others):
    """A fault of the barriers: the filter brakes while it lasts, with a reason, and continues."""

    def happens(name, core, lie=None):
        run = Run(name, core)
        run.world.lie = lie
        run.steps(10)
        run.world.scene = Scene(others=others)
        for report in run.steps(5):
            assert (report["status"], report["reason"]) == (FilterStatus.BACKUP, Reason.BARRIERS)
        run.world.scene = Scene()
        assert run.steps(2)[-1]["status"] < FilterStatus.BACKUP
        assert is_closed(name, core, Scene(others=others))

    return happens


def after_an_alarm(fault):
    """The same fault while the plant raises an alarm: that hides nothing."""

    def happens(name, core):
        fault(name, core, lambda truth: truth._replace(fault=int(Reason.SLIP)))

    return happens


def is_closed(name, core, scene, **options):
    """Whether a filter refuses a scene from the beginning, in words, or brakes in it."""
    try:
        begun = filter_of(name, core, world_of(core, scene=scene), **options)
        quietly(begun.reset)
        return quietly(begun.step)["status"] == FilterStatus.BACKUP
    except InvalidInputError:
        return True


def too_near(run, share):
    """Let a wall appear at a share of the way that the robot needs to stop, on a cell's edge."""
    x, v = run.world.x[0], run.world.x[2]
    assert v > 0.5
    run.world.scene = Scene(wall=round(20.0 * (x + share * v * v / 10.0)) / 20.0)


def calms_down(run, steps=400):
    """Every entry is announced, and in the end the filter promises again."""
    reports = run.steps(steps, 0.0 * AHEAD)
    assert reports[-1]["status"] < CALM


def news_too_near(share):
    def happens(name, core):
        run = Run(name, core)
        run.steps(30)
        too_near(run, share)
        assert run.step()["status"] >= CALM
        calms_down(run)

    return happens


def after_backup(share):
    def happens(name, core):
        run = Run(name, core)
        run.steps(40)
        run.world.lie = lambda truth: truth._replace(x=np.full(4, np.nan))
        assert run.step()["status"] == FilterStatus.BACKUP
        too_near(run, share)
        assert run.step()["status"] == FilterStatus.BACKUP
        run.world.lie = None
        assert run.step()["status"] >= CALM
        calms_down(run)

    return happens


def after_a_conflict(name, core):
    run = Run(name, core)
    run.steps(2, 0.0 * AHEAD)  # the world's shapes count from the reset, the filter's from now on
    far = 1.2 + 0.8 * T * run.world.steps
    sides = tuple(
        Disc(f"{to}", 1, run.world.x[:2] + far * np.array(to), 0.6, tuple(-0.8 * np.array(to)))
        for to in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
    )
    run.world.scene = Scene(others=sides)
    reports = run.steps(200, 0.0 * AHEAD)
    assert max(report["status"] for report in reports) >= CALM


def after_a_push(name, core):
    run = Run(name, core)
    run.world.scene = Scene(wall=0.6)
    run.steps(60)
    run.world.x[2] += 3.0
    assert run.step(0.0 * AHEAD)["status"] >= CALM
    calms_down(run)


def without_goal(name, core):
    try:
        guided = filter_of(name, core, world_of(core), guidance="geodesic")
    except InvalidInputError:
        return
    for call in (guided.reset, guided.step, guided.step):
        with pytest.raises(InvalidInputError):
            quietly(call)


def before_reset(name, core):
    options = {} if core == "drag" else {"guidance": "geodesic"}
    begun = filter_of(name, core, world_of(core), goal=(FAR - 1.0, 0.0), **options)
    with pytest.raises(InvalidInputError):
        quietly(begun.step)


def with_x(value):
    return lambda truth: truth._replace(x=np.where([0, 1, 0, 0], value, truth.x))


SKEW = np.diag([1e-4] * 4) + 1e-5 * np.eye(4, k=1)
INDEFINITE = np.eye(4) * 1.6 - 0.6  # no pair is, all four together are
FAULTS = {
    "nan": of_state(with_x(np.nan), Reason.STATE),
    "too far": of_state(with_x(1e5), Reason.STATE),
    "too fast": of_state(lambda e: e._replace(x=np.array([0, 0, 1e7, 0])), Reason.STATE),
    "late": of_state(lambda e: e._replace(age=0.2), Reason.AGE),
    "clock": of_state(lambda e: e._replace(time=0.05), Reason.CLOCK),
    "masked": of_state(lambda e: e._replace(x=np.ma.array(e.x, mask=[1, 0, 0, 0])), Reason.STATE),
    "skew covariance": of_state(lambda e: e._replace(covariance=SKEW), Reason.STATE),
    "indefinite covariance": of_state(lambda e: e._replace(covariance=INDEFINITE), Reason.STATE),
    "raises": raises,
    "bad row": of_barriers(OwnLinear("broken", 1, 4 * (np.nan,))),
    "limit": of_barriers(SpeedLimit("limit", 1, 0.05)),
    "limit after an alarm": after_an_alarm(of_barriers(SpeedLimit("limit", 1, 0.05))),
    "bad row after an alarm": after_an_alarm(of_barriers(OwnLinear("broken", 1, 4 * (np.nan,)))),
    "news much too near": news_too_near(0.3),
    "news too near": news_too_near(1.1),
    "after BACKUP, much too near": after_backup(0.3),
    "after BACKUP, too near": after_backup(1.1),
    "after a conflict": after_a_conflict,
    "after a push": after_a_push,
    "guidance without a goal": without_goal,
    "guidance before reset": before_reset,
}

ARRAYS = "shapes", "map", "scan"
OF_PYTHON = "masked", "skew covariance", "indefinite covariance", "raises", "guidance before reset"


def why_not(name, core, fault):
    """Why a cell has no meaning; "" where it has one."""
    if name in ARRAYS and core not in ("compiled", "vector"):
        return "how elements are read does not depend on the core; see `refused` for any model"
    if name == "change_scene" and core != "compiled":
        return "the environment that changes its scene brings the plant of the compiled core"
    if core == "velocity filter" and fault in OF_PYTHON:
        return "it is given pose and twist: no covariance, no reader, no reset to wait for"
    if core == "velocity filter" and "after an alarm" in fault:
        return "its alarms are its own"
    fault = fault.removesuffix(" after an alarm")
    if name == "change_scene" and fault in ("bad row", "limit", "after a conflict"):
        return "a scene holds what JSON can say, and as many barriers as the first one"
    if core == "no period" and fault == "limit":
        return "what an input changes within one period is not known without a period"
    if core == "vector" and fault == "masked":
        return "N states are one array, and a mask hides parts of it: the next test"
    return ""


def test_what_moves_is_not_accepted_without_a_time():
    passing = Disc("passing", 1, (3.0, 0.0), 0.5, (-1.0, 0.0))
    for core in ("compiled", "daqp", "drag"):
        for others, reason in (((), 0), ((passing,), Reason.CLOCK)):
            world = world_of(core, scene=Scene(others=others), lie=lambda e: e._replace(time=None))
            begun = filter_of("list", core, world, period=None)
            quietly(begun.reset)
            report = quietly(begun.step)
            assert (report["status"] == FilterStatus.BACKUP) == bool(others)
            assert report["reason"] in (reason, reason and Reason.BARRIERS)


CELLS = pairwise(INPUTS, CORES, FAULTS, allowed=lambda *cell: not why_not(*cell))


@pytest.mark.parametrize(("name", "core", "fault"), CELLS)
def test_every_input_into_every_core_fails_closed(name, core, fault):
    FAULTS[fault](name, core)


@pytest.mark.parametrize("name", ARRAYS)
def test_what_a_core_does_not_take_is_refused_or_brakes(name):
    assert is_closed(name, "drag", Scene())
