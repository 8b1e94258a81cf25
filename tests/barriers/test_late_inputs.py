"""An input that moves h but enters too late for the row is named before anything runs."""

import re
from dataclasses import dataclass

import numpy as np
import pytest
from needs import remedy

import hcbf_gym
from hcbf_gym import models, wrappers
from hcbf_gym.barriers import Barrier, Disc, Function, GeneralRows, HalfPlane, Jet, LinearClassK
from hcbf_gym.barriers.convexity import is_convex, warn_of_concave
from hcbf_gym.barriers.late_inputs import LateInputs
from hcbf_gym.errors import InvalidInputError, SafetyWarning
from hcbf_gym.models import Box, ControlAffine, DoubleIntegrator, KinematicBicycle, Unicycle
from tests.worlds import OwnLinear, World

DISC, WALL = Disc("disc", 1, center=(3.0, 0.0)), HalfPlane("wall", 1, (-1.0, 0.0), -2.0)


def quadrotor(np=np):
    """Planar: x, z, tilt and their rates; thrust and torque."""

    def g(x):
        zero, one = 0.0 * x[0], 0.0 * x[0] + 1.0
        columns = [[zero] * 3 + [-np.sin(x[2]), np.cos(x[2]), zero], [zero] * 5 + [9.0 * one]]
        return np.stack([np.stack(column) for column in columns], axis=1)

    return ControlAffine(
        lambda x: np.stack([x[3], x[4], x[5], 0.0 * x[0], 0.0 * x[0] - 9.81, 0.0 * x[0]]),
        g,
        n=6,
        n_u=2,
    )


def followed():
    """A point with a velocity for an input, and an agent that moves at a constant one."""
    return ControlAffine(
        lambda x: np.array([0.0, 0.0, x[4], x[5], 0.0, 0.0]), lambda x: np.eye(6, 2), n=6, n_u=2
    )


@dataclass(frozen=True)
class Apart(Barrier):
    """A metre away from the agent in x[2:4]."""

    def jet(self, x, t=0.0):
        to, n = x[:2] - x[2:4], np.zeros(6)
        distance = np.linalg.norm(to)
        n[:4] = np.concatenate([to, -to]) / distance
        return Jet(distance - 1.0, n, np.zeros((6, 6)), 0.0, np.zeros(6), 0.0)


def late_in(model, barriers):
    """What is late in barriers, a sentence each."""
    rows = GeneralRows(model, LinearClassK(2.0), LinearClassK(2.0))
    return LateInputs(model).find(barriers, [rows.reach(barrier) for barrier in barriers])


@pytest.mark.parametrize(
    ("model", "barrier", "late"),
    [
        (KinematicBicycle(), DISC, r"u\[1\].*derivative 1.*u\[0\] by derivative 2"),
        (Unicycle(), DISC, r"u\[0\].*derivative 1.*u\[1\] by derivative 2"),
        (quadrotor(), WALL, r"u\[0\].*derivative 2.*u\[1\] by derivative 4"),
        (
            DoubleIntegrator(),
            OwnLinear("mixed", 1, (0.0, 1.0, -1.0, 0.0)),
            r"u\[1\] by derivative 2",
        ),
    ],
    ids=["bicycle", "unicycle", "quadrotor", "own barrier of a point"],
)
def test_it_is_refused_with_the_input_its_derivative_and_the_remedy(model, barrier, late):
    (text,) = late_in(model, [barrier])
    assert re.search(late, text)
    known = hcbf_gym.Plant(model, [barrier], lambda env, *_: env.x, period=0.05)
    with pytest.raises(InvalidInputError, match=rf"{late}.*a point ahead.*allow_late_inputs"):
        wrappers.SafetyFilter(car(), plant=known)
    with pytest.warns(UserWarning, match=f"{late}.*allowed") as warned:
        wrappers.SafetyFilter(car(), plant=known, allow_late_inputs=True)
    assert len(warned) == 1


@pytest.mark.parametrize(
    ("model", "barrier"),
    [
        (DoubleIntegrator(), HalfPlane("wall", 1, (1.0, 0.0))),
        (DoubleIntegrator(drag=0.3), DISC),
        (DoubleIntegrator(3), OwnLinear("ceiling", 1, (0.0, 0.0, -1.0, 0.0, 0.0, 0.0))),
        (
            models.SingleIntegrator(6),
            OwnLinear("first joints", 1, (1.0, 2.0, 0.0, 0.0, 0.0, 0.0)),
        ),
        (followed(), Apart("agent", 1)),
        (KinematicBicycle(), OwnLinear("speed", 1, (0.0, 0.0, 0.0, -1.0))),
        (Unicycle(), OwnLinear("heading", 1, (0.0, 0.0, 1.0))),
    ],
    ids=lambda value: getattr(value, "name", type(value).__name__),
)
def test_a_row_that_holds_every_input_that_matters_is_not_refused(model, barrier):
    assert late_in(model, [barrier]) == []


def test_functions_are_looked_at_by_their_derivatives():
    jnp = pytest.importorskip("jax", reason=remedy("jax")).numpy

    def ahead(x, t):
        return jnp.hypot(x[0] + 0.2 * jnp.cos(x[2]) - 3.0, x[1] + 0.2 * jnp.sin(x[2])) - 1.0

    def brakes(x, t):
        return jnp.hypot(x[0] - 3.0, x[1]) - 1.0 - 0.1 * x[3] ** 2

    assert not late_in(Unicycle(), [Function("ahead", 1, ahead)])
    assert not late_in(KinematicBicycle(), [Function("brakes", 1, brakes)])
    axle = Function("axle", 1, lambda x, t: jnp.hypot(x[0] - 3.0, x[1]) - 1.0)
    for model, last in ((Unicycle(), "2"), (KinematicBicycle(), "2")):
        assert f"by derivative {last}" in late_in(model, [axle])[0]
    wall = Function("wall", 1, lambda x, t: 2.0 - x[0])
    assert "u[1] by derivative 4" in late_in(quadrotor(jnp), [wall])[0]


def test_links_are_those_of_the_equations():
    links = LateInputs(KinematicBicycle())
    np.testing.assert_array_equal(np.flatnonzero(links.states[0]), [2, 3])
    np.testing.assert_array_equal(links.inputs, [[0, 1], [0, 1], [0, 1], [1, 0]])


LIMITS = Box([-3.0, -0.5], [3.0, 0.5])


def car():
    return World(KinematicBicycle(), 0.05, 3.0, (0.0, 0.1, 0.0, 1.0))


def plant(barriers):
    state = lambda env, observation, info: env.x  # noqa: E731
    return hcbf_gym.Plant(
        model=KinematicBicycle(), input_set=LIMITS, barriers=barriers, state=state, period=0.05
    )


def test_the_filter_refuses_at_construction_or_at_the_first_reset():
    with pytest.raises(InvalidInputError, match=r"u\[0\] by derivative 2"):
        wrappers.SafetyFilter(car(), plant=plant([DISC]))
    read = plant(lambda env, observation, info: [DISC])
    env = wrappers.SafetyFilter(car(), plant=read)
    with pytest.raises(InvalidInputError, match=r"u\[0\] by derivative 2"):
        env.reset(seed=0)


def test_what_comes_into_sight_later_brakes_and_names_what_is_late():
    seen = []
    env = wrappers.SafetyFilter(car(), plant=plant(lambda env, observation, info: list(seen)))
    env.reset(seed=0)
    env.step(np.array([1.0, 0.0]))
    seen.append(DISC)
    with pytest.warns(UserWarning, match="safety filter") as texts:
        *_, info = env.step(np.array([1.0, 0.0]))
    assert any("u[0] by derivative 2" in str(warning.message) for warning in texts)
    assert info["safety_filter"]["status"] == 5
    for _ in range(20):
        env.step(np.array([3.0, 0.5]))
    assert abs(env.unwrapped.x[3]) < 1e-6


def test_a_minimum_of_conditions_of_different_relative_degree_is_refused():
    jnp = pytest.importorskip("jax.numpy")
    both = Function("both", 1, lambda x, t: jnp.minimum(x[0], 1.0 - x[2]))
    with pytest.raises(InvalidInputError, match="one relative degree"):
        late_in(DoubleIntegrator(), [both])


class AtSomeStates(Barrier):
    """A condition that an input enters at once only where v_x is positive."""

    def jet(self, x, t=0.0):
        gradient = np.array([1.0, 0.0, max(x[2], 0.0), 0.0])
        return Jet(1.0, gradient, np.zeros((4, 4)), 0.0, np.zeros(4), 0.0)


def test_a_jet_of_different_relative_degrees_is_refused_for_that_alone():
    rows = GeneralRows(DoubleIntegrator(drag=0.5), LinearClassK(1.0), LinearClassK(1.0))
    with pytest.raises(InvalidInputError, match=r"^some: an input enters derivative 1"):
        rows([AtSomeStates("some", 1)], np.zeros(4))


def test_the_inside_of_a_circle_is_reported_as_no_convex_h():
    jnp = pytest.importorskip("jax.numpy")
    inside = Function("inside", 1, lambda x, t: 2.0 - jnp.hypot(x[0], x[1]))
    with pytest.warns(SafetyWarning, match="not convex"):
        warn_of_concave([inside, DISC, WALL], DoubleIntegrator())
    assert is_convex(DISC, DoubleIntegrator())
