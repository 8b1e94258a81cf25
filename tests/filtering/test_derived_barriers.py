"""Rows read what a class that derives from a barrier states anew, or the robot brakes."""

from dataclasses import dataclass, fields

import numpy as np
import pytest

from hcbf_gym import Plant
from hcbf_gym.barriers import Barrier, Disc, Function, HalfPlane, PlanarBarrier
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.filter.batch_filter import BatchFilter
from hcbf_gym.models import Box, DoubleIntegrator
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers import SafetyFilter
from hcbf_robots.maps import Grid, MapClass, RankedMap
from tests.needs import remedy
from tests.worlds import OwnDisc, World

MODELS = {"planar": DoubleIntegrator(), "with drag": DoubleIntegrator(drag=0.5)}
T, LESS = 0.05, 0.5
pytestmark = pytest.mark.filterwarnings(
    "ignore::hcbf_gym.errors.SafetyWarning", "ignore:safety filter:UserWarning"
)


class LessH:
    def h(self, x, t=0.0):
        return super().h(x, t) - LESS


class LessJet:
    def jet(self, x, t=0.0):
        jet = super().jet(x, t)
        return jet._replace(h=jet.h - LESS)


class LessBoth:
    def jet(self, x, t=0.0):
        return super().jet(x, t)._replace(h=self.h(x, t))

    def h(self, x, t=0.0):
        return super().jet(x, t).h - LESS


class LessPlanarJet:
    def planar_jet(self, q):
        h, gradient, hessian = super().planar_jet(q)
        return h - LESS, gradient, hessian


class Squared:
    """Of a disc: h = d² − r², which is no distance, so that the disc's core is not its core."""

    def planar_jet(self, q):
        away = q - np.array(self.center)
        return float(away @ away - (self.radius + LESS) ** 2), 2.0 * away, 2.0 * np.eye(2)


class Quick:
    """All jets at once, of the h without `LESS`."""

    def batch(self, x, t):
        return super().batch(x, t)


class Slow:
    reads_position = False


def derived(base, *changes):
    """A frozen class that derives from `base`, with changes in the order of their writing."""
    for change in changes:
        base = dataclass(frozen=True, eq=False)(type(f"{change.__name__}Of", (change, base), {}))
    return base


def a_function(change, h):
    pytest.importorskip("jax", reason=remedy("jax"))
    return derived(Function, change)("f", 1, h)


DISC = ("disc", 1, (3.0, 0.1), 0.5)
WALL = ("wall", 1, (-1.0, 0.0), -3.0)
READ = {
    "jet of a disc": derived(Disc, LessJet)(*DISC),
    "jet of a moving disc": derived(Disc, LessJet)(*DISC, (-0.2, 0.0)),
    "planar jet of a disc": derived(Disc, LessPlanarJet)(*DISC),
    "planar jet of a moving disc": derived(Disc, LessPlanarJet)(*DISC, (-0.2, 0.0)),
    "square of a disc": derived(Disc, Squared)(*DISC),
    "planar jet of a wall": derived(HalfPlane, LessPlanarJet)(*WALL),
    "jet and h of a disc": derived(Disc, LessBoth)(*DISC),
    "jet of a disc of a user's": derived(OwnDisc, LessJet)(*DISC),
    "jet of quick jets": derived(OwnDisc, Quick, LessJet)(*DISC),
    "planar jet after a jet": derived(Disc, LessJet, LessPlanarJet)(*DISC),
}


def a_map():
    cells = np.zeros((40, 60), dtype=bool)
    cells[:, 40:] = True
    ranked = RankedMap(
        Grid(0.1, (-1.0, -2.0, 0.0), cells.shape), (MapClass("w", 1, "keepout", cells),)
    )
    return ranked.conditions[0]


def like(barrier, change):
    """The same barrier, of a class with a change."""
    given = {field.name: getattr(barrier, field.name) for field in fields(barrier) if field.init}
    return derived(type(barrier), change)(**given)


UNREAD = {
    "h of a disc": lambda: derived(Disc, LessH)(*DISC),
    "h of a disc of a user's": lambda: derived(OwnDisc, LessH)(*DISC),
    "h of a jet": lambda: derived(OwnDisc, LessJet, LessH)(*DISC),
    "jet of a function": lambda: a_function(LessJet, lambda x, t: 3.0 - x[0]),
    "h of a function": lambda: a_function(LessH, lambda x, t: 3.0 - x[0]),
    "jet of a map": lambda: like(a_map(), LessJet),
    "h of a map": lambda: like(a_map(), LessH),
}


def drive(model, barrier, steps=120):
    """The statuses on the way to a barrier, and the least h of its class."""
    plant = Plant(model, lambda *_: [barrier], lambda env, x, info: x, period=T)
    env = SafetyFilter(World(model, T, 2.0, (0.0,) * 4), plant=plant)
    env.reset()
    found, least = [], np.inf
    for step in range(1, steps + 1):
        x, _, _, _, info = env.step(np.array([1.0, 0.0]))
        found.append(int(info["safety_filter"]["status"]))
        least = min(least, barrier.h(x, step * T), barrier.jet(x, step * T).h)
    return found, least


@pytest.mark.parametrize("barrier", READ)
@pytest.mark.parametrize("model", MODELS)
def test_rows_read_what_a_class_states_anew(model, barrier):
    found, least = drive(MODELS[model], READ[barrier])
    assert FilterStatus.BACKUP not in found
    assert 0.0 <= least < 0.2  # it came near, and stopped at its own h


@pytest.mark.parametrize(
    ("model", "barrier"),
    [
        (model, name)
        for model in MODELS
        for name in UNREAD
        if model == "planar" or "map" not in name
    ],
)
def test_a_class_whose_h_rows_would_not_read_makes_the_robot_brake(model, barrier):
    found, _ = drive(MODELS[model], UNREAD[barrier](), steps=4)
    assert set(found) == {FilterStatus.BACKUP}


@pytest.mark.parametrize("barrier", UNREAD)
def test_such_a_class_is_refused_with_what_rows_read(barrier):
    filt = BatchFilter(Box.symmetric(2.0), T)
    with pytest.raises(InvalidInputError, match=r"with its own (h|jet), which rows do not read"):
        filt.set_scene([UNREAD[barrier]()])


def test_a_function_may_say_that_it_does_not_read_the_position():
    slow = a_function(Slow, lambda x, t: 1.0 - x[2] - x[3])
    found, least = drive(MODELS["with drag"], slow)
    assert FilterStatus.BACKUP not in found
    assert 0.0 <= least < 0.2


@pytest.mark.parametrize("name", ["batch", "core"])
def test_what_another_h_is_the_source_of_is_not_inherited(name):
    base = derived(OwnDisc, Quick) if name == "batch" else Disc
    default = getattr(Barrier if name == "batch" else PlanarBarrier, name)
    assert getattr(base, name) is not default
    assert getattr(derived(base, LessPlanarJet), name) is default
