"""A user's own barrier: accepted wherever built-in ones are, and named for JSON."""

import json
from dataclasses import dataclass, replace

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import Plant, barriers, models, scenarios, wrappers
from hcbf_gym.barriers import (
    Barrier,
    BarrierSet,
    Core,
    Disc,
    HalfPlane,
    Jet,
    LinearClassK,
    PlanarBarrier,
    RowSettings,
    SpeedLimit,
)
from hcbf_gym.barriers.many import Several
from hcbf_gym.barriers.planar_rows import planar_rows
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.models import Unicycle
from hcbf_gym.scenarios import Scenario
from hcbf_gym.scenarios.references import PointReference
from hcbf_robots import VelocityFilter
from tests.worlds import World

USUAL, HELD = RowSettings(alpha2=LinearClassK(2.0)), RowSettings(period=0.02, u_max=7.1)


@dataclass(frozen=True)
class Round(PlanarBarrier):
    """The outside of the unit disc, written as a user would."""

    reach: float = 1.0

    def planar_jet(self, q):
        distance = np.linalg.norm(q)
        n = q / distance
        return distance - self.reach, n, (np.eye(2) - np.outer(n, n)) / distance


@dataclass(frozen=True)
class Convex(Round):
    def core(self, q, reach):
        return Core(float(np.linalg.norm(q)), self.reach, True)


@dataclass(frozen=True)
class EnergyLimit(Barrier):
    """A barrier on the velocity, h = e − ½‖v‖²."""

    energy: float = 0.5
    reads_position = False

    def jet(self, x, t=0.0):
        gradient = np.concatenate([np.zeros(2), -x[2:]])
        hessian = np.diag([0.0, 0.0, -1.0, -1.0])
        return Jet(self.energy - 0.5 * x[2:] @ x[2:], gradient, hessian, 0.0, np.zeros(4), 0.0)


@dataclass(frozen=True)
class Unnamed(Round):
    """It is not registered."""


barriers.register("tests-round", Round)
barriers.register("tests-energy", EnergyLimit)


def states(n):
    rng = np.random.default_rng(0)
    return np.column_stack([rng.normal(0, 2, (n, 2)), rng.normal(0, 0.5, (n, 2))]), rng.random(n)


def scene(own):
    wall = HalfPlane("wall", 1, (0.0, 1.0), -3.0)
    return Scenario("own", (wall, own), PointReference((6.0, 0.1)), (-3.0, 0.0), task="reach")


@pytest.mark.parametrize("how", [USUAL, HELD], ids=["usual", "held"])
@pytest.mark.parametrize("own", [Convex("own", 2), Round("own", 2)], ids=["convex", "unknown"])
def test_its_rows_are_beside_those_of_built_in_barriers(own, how):
    x, t = states(20)
    built_in = Disc("own", 2)
    wall, cap = HalfPlane("wall", 1), SpeedLimit("cap", 1, 2.0)
    mixed = BarrierSet([(wall, own, cap)] * 20)
    same = BarrierSet([(wall, built_in, cap)] * 20)
    if how.held and not isinstance(own, Convex):  # without a core the usual row is all there is
        dip = 0.5 * how.u_max * how.period**2
        kept = np.full(same.kind.shape, dip)  # a margin that is one number is for strict rows
        expected = planar_rows(same, x, t, replace(how, period=None), kept).b[:, 1]
    else:
        expected = planar_rows(same, x, t, how, 0.01).b[:, 1]
    rows = planar_rows(mixed, x, t, how, 0.01)
    np.testing.assert_allclose(rows.b[:, 1], expected, atol=1e-9)
    np.testing.assert_allclose(rows.b[:, [0, 2]], planar_rows(same, x, t, how, 0.01).b[:, [0, 2]])
    np.testing.assert_allclose(rows.a, planar_rows(same, x, t, how).a, atol=1e-12)
    np.testing.assert_allclose(mixed.values(x, t), same.values(x, t), atol=1e-12)
    np.testing.assert_allclose(mixed.along(x, t), same.along(x, t), atol=1e-12)
    for got, wanted in zip(mixed.sense(x, t), same.sense(x, t), strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-12)


def test_a_barrier_of_relative_degree_one_gets_its_row():
    x, t = states(5)
    rows = planar_rows(BarrierSet([(EnergyLimit("energy", 1),)] * 5), x, t, USUAL)
    np.testing.assert_allclose(rows.a[:, 0], -x[:, 2:])
    np.testing.assert_allclose(rows.b[:, 0], -2.0 * (0.5 - 0.5 * np.sum(x[:, 2:] ** 2, axis=1)))


def test_a_set_takes_a_built_in_barrier_back_in_its_place():
    both = BarrierSet([(Round("own", 1),)])
    both.set_scene(0, (Disc("disc", 1, (1.0, 0.0)),))
    x, t = states(1)
    assert not both.own
    np.testing.assert_array_equal(
        both.values(x, t), BarrierSet([(Disc("disc", 1, (1.0, 0.0)),)]).values(x, t)
    )


@pytest.mark.parametrize("own", [Round("own", 1), EnergyLimit("own", 1)], ids=lambda b: str(b)[:5])
def test_a_scene_with_it_runs_under_the_filter_as_one_environment_and_as_many(own):
    env = gym.make("HCBF-Regions-v0", scenario=scene(own))
    env = wrappers.SafetyFilter(env, program="lex-cbf-qp")
    env.reset(seed=0)
    least = np.inf
    for _ in range(300):
        *_, info = env.step(np.array([5.0, 0.0]))
        least = min(least, info["min_h"][1])
        assert info["min_h"][1] <= info["h"][1] + 1e-12
    assert -0.02 <= least < 0.2
    many = gym.make_vec("HCBF-Regions-v0", num_envs=2, scenario=scene(own))
    many = wrappers.VectorSafetyFilter(many, program="lex-cbf-qp")
    many.reset(seed=0)
    for _ in range(300):
        *_, infos = many.step(np.array([[5.0, 0.0]] * 2))
    np.testing.assert_allclose(infos["h"][0], info["h"], atol=1e-9)


def test_registered_it_travels_through_json():
    with pytest.raises(InvalidInputError, match="register"):
        scene(Unnamed("own", 1)).to_dict()
    with pytest.raises(UnknownNameError, match="register"):
        barriers.from_dict({"kind": "round", "name": "own", "priority": 1})
    barriers.register("tests-round", Round)  # again is no harm
    own = scene(Round("own", 1, reach=0.5))
    assert scenarios.from_dict(json.loads(json.dumps(own.to_dict()))).barriers == own.barriers


def test_other_things_than_barriers_are_refused_by_name():
    for make in (
        lambda: barriers.register("disc", Round),
        lambda: barriers.register("", Round),
        lambda: barriers.register("text", str),
        lambda: barriers.register("object", Round("own", 1)),
        lambda: BarrierSet([("wall",)]),
        lambda: BarrierSet([(Disc("a", 1),)]).set_scene(0, (Disc("a", 1), Disc("b", 1))),
    ):
        with pytest.raises(InvalidInputError, match="expected"):
            make()


class Fence(Several):
    """Several barriers in one: posts in a row."""

    conditions = tuple(Disc(f"post {y}", 1, center=(1.0, y), radius=0.1) for y in (0.0, 0.3))


@pytest.mark.filterwarnings("ignore:safety filter")
@pytest.mark.parametrize(
    "model", [models.DoubleIntegrator(), models.SingleIntegrator(), Unicycle()]
)
def test_an_element_of_several_barriers_is_taken_whatever_the_model_is(model):
    def filtered(scene):
        plant = Plant(model, scene, lambda env, *_: env.x.copy(), period=0.02)
        env = wrappers.SafetyFilter(World(model, limit=1.0), plant=plant, allow_late_inputs=True)
        env.reset(seed=0)
        return env.step(np.ones(model.n_u))[4]["safety_filter"]

    fence, posts = filtered([Fence()]), filtered(list(Fence.conditions))
    assert len(fence["margin"]) == len(Fence.conditions)
    for name, value in posts.items():
        np.testing.assert_array_equal(fence[name], value, name)


def test_a_velocity_filter_takes_it_too():
    safe = VelocityFilter("cart", [Fence()], period=0.05)
    report = safe.step((0.5, 0.0), np.zeros(3), np.zeros(3), 0.0)[1]
    assert len(report["margin"]) == len(Fence.conditions)
