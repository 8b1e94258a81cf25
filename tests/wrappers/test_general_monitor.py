"""When the filter of any model raises an alarm."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hcbf_gym import _core
from hcbf_gym.arrays import numbers_of
from hcbf_gym.barriers.unknown import largest
from hcbf_gym.filter import bound, plants
from hcbf_gym.filter.model_rows import driven_alone
from hcbf_gym.filter.samples import State
from hcbf_gym.models import (
    Box,
    ControlAffine,
    DoubleIntegrator,
    KinematicBicycle,
    SingleIntegrator,
    Unicycle,
)
from hcbf_gym.models.compiled import compiled
from hcbf_gym.models.plant import Reason

T = 0.02


def swing(n=2, n_u=1):
    """A pendulum about its upper rest, in NumPy."""
    return ControlAffine(
        lambda x: np.array([x[1], 15.0 * np.sin(x[0])]),
        lambda x: np.array([[0.0], [3.0]]),
        n=n,
        n_u=n_u,
    )


def quadrotor():
    """Planar: x, z, tilt and their rates; thrust and torque, each per mass and inertia."""
    zero = np.zeros((3, 2))

    def g(x):
        push = np.array([[-np.sin(x[2]), 0.0], [np.cos(x[2]), 0.0], [0.0, 50.0]])
        return np.vstack([zero, push])

    return ControlAffine(lambda x: np.array([*x[3:], 0.0, -9.81, 0.0]), g, n=6, n_u=2)


PLANTS = {
    "point": (DoubleIntegrator(), Box.symmetric(5.0)),
    "boat": (DoubleIntegrator(drag=0.5), Box.symmetric(2.0)),
    "one input": (DoubleIntegrator(1), Box.symmetric(2.0, 1)),
    "three inputs": (DoubleIntegrator(3), Box.symmetric(2.0, 3)),
    "velocities": (SingleIntegrator(), Box.symmetric(1.0)),
    "arm": (SingleIntegrator(6), Box.symmetric(0.5, 6)),
    "unicycle": (Unicycle(), Box([-1.0, -2.0], [1.0, 2.0])),
    "bicycle": (KinematicBicycle(), Box([-3.0, -0.5], [3.0, 0.5])),
    "pendulum": (swing(), Box.symmetric(2.0, 1)),
    "quadrotor": (quadrotor(), Box([-20.0, -1.0], [20.0, 1.0])),
}


def inputs(u_set, seed, count):
    """Nominal inputs: each held for a while, of any size."""
    rng = np.random.default_rng(seed)
    held = rng.uniform(u_set.low, u_set.high, (count // 10 + 1, u_set.n_u))
    return np.repeat(held * rng.random((len(held), 1)), 10, axis=0)[:count]


def balance(name, x, u):
    """Keep plants that fall over where they are asked to be."""
    if name == "pendulum":
        return np.clip(0.2 * u - 12.0 * x[0] - 2.0 * x[1], -2.0, 2.0)
    if name == "quadrotor":
        tilt = np.clip(0.3 * x[3] + 0.1 * u[1], -0.4, 0.4)
        thrust = 9.81 + 0.05 * u[0] - x[4]
        return np.clip([thrust, 2.0 * (tilt - x[2]) - 0.4 * x[5]], [-20.0, -1.0], [20.0, 1.0])
    if name == "bicycle":
        return np.array([u[0] - x[3], u[1]])
    if name in ("point", "three inputs", "one input"):
        return u - x[u.size :]
    return u


def semi_implicit(model, x, u, dt):
    """As physics engines integrate: rates first, then what moves by the new ones."""
    first = x + dt * (model.f(x) + model.g(x) @ u)
    driven = (np.abs(model.g(x)) > 0.0).any(axis=1)
    new = np.where(driven, first, x)
    return np.where(driven, first, x + dt * (model.f(new) + model.g(new) @ u))


def alarm(name, integrate=None, sense=None, spread=None, seed=0, count=500, drive=None):
    """The first alarm of a run and the sample at which it came; (NONE, count) without one."""
    model, u_set = PLANTS[name]
    plant = np.zeros(1, dtype=plants.plant_dtype(model.n_u))
    plant["elapsed"] = T
    reported = np.zeros(1, dtype=bound.plant_dtype(model.n_u))
    n = model.n
    states = State(*(np.zeros((1, *shape)) for shape in ((n,), (n,), (n,), (n, n), (n,))))
    states.covariance[:] = 0.0 if spread is None else spread
    limits = u_set.low, u_set.high, np.zeros(0)
    step_of = _core.ModelStep(
        compiled(model), np.zeros(8), np.zeros((2, 4)), limits, largest(u_set),
        ~driven_alone(model), u_set.radius, 3.0, T, -1, 1,
    )  # fmt: skip
    constants = np.zeros(plants.CONSTANTS.itemsize // 8)
    watching = _core.Filter(constants, np.zeros(0), numbers_of(plant), 1)
    watching.set_states(*states)
    watching.set_report(numbers_of(reported), np.zeros((1, 0)))
    x, asked = np.zeros(n), inputs(u_set, seed, count)
    past, u = [], np.zeros(model.n_u)
    for k in range(count):
        past.append(x)
        states.x[0] = x if sense is None else sense(past, k)
        plant["time"], plant["input"] = k * T, u
        assert watching.sense(step_of, False)
        if plant["alarm"][0]:
            return Reason(plant["alarm"][0]), k
        u = asked[k] if drive is None else drive(k)
        u = u_set.project(balance(name, x, u) if drive is None else u)
        step = model.step if integrate is None else lambda *a: integrate(model, *a)
        x = step(x, u, T)
    return Reason.NONE, count


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("integrate", [None, semi_implicit], ids=["exact", "semi-implicit"])
@settings(max_examples=5)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_plant_that_is_its_model_raises_no_alarm(name, integrate, seed):
    assert alarm(name, integrate, seed=seed, count=300) == (Reason.NONE, 300)


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("noise", [0.001, 0.02])
def test_noise_that_is_declared_raises_no_alarm(name, noise):
    model, rng = PLANTS[name][0], np.random.default_rng(0)
    spread = noise**2 * np.eye(model.n)
    found = alarm(
        name, sense=lambda past, k: past[-1] + rng.normal(0.0, noise, model.n), spread=spread
    )
    assert found == (Reason.NONE, 500)


def forward(k):
    """Speed up along (3, 1), and go on."""
    return np.array([3.0, 1.0]) * (10 <= k < 22)


def shown(change):
    """A reader with a wrong position and the right velocity, for the planar double integrator."""

    def sense(past, k):
        return np.concatenate([change([x[:2] for x in past], k), past[-1][2:]])

    return sense


WRONG = {
    "frozen": lambda past, k: past[0],
    "swapped": lambda past, k: past[-1][::-1],
    "half": lambda past, k: 0.5 * past[-1],
    "double": lambda past, k: 2.0 * past[-1],
    "a fifth more": lambda past, k: 1.2 * past[-1],
    "late": lambda past, k: past[max(0, k - 5)],
}


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("integrate", [None, semi_implicit], ids=["exact", "semi-implicit"])
def test_a_position_that_does_not_move_as_the_velocity_does_is_seen_within_half_a_second(
    wrong, integrate
):
    found, k = alarm("point", integrate, shown(WRONG[wrong]), drive=forward)
    assert found == Reason.MOTION
    assert (k - 10) * T <= 0.5


@pytest.mark.parametrize("wrong", WRONG)
def test_so_it_is_where_the_input_is_the_velocity(wrong):
    found, k = alarm(
        "velocities",
        sense=lambda past, k: WRONG[wrong](past, k),
        drive=lambda k: np.array([0.9, 0.3]) * (k >= 10),
    )
    assert found in (Reason.MOTION, Reason.INPUT)
    assert (k - 10) * T <= 0.5


def test_a_heading_that_is_wrapped_is_no_jump():
    def wrapped(past, k):
        return np.array([*past[-1][:2], np.remainder(past[-1][2] + np.pi, 2 * np.pi) - np.pi])

    turning = np.array([0.5, 2.0])
    assert alarm("unicycle", sense=wrapped, drive=lambda k: turning)[0] == Reason.NONE


def test_an_input_that_is_doubled_or_turned_is_seen():
    for name in ("point", "boat", "pendulum", "bicycle"):
        for gain in (2.0, -1.0):
            found, _ = alarm(name, lambda model, x, u, dt: model.step(x, gain * u, dt))  # noqa: B023
            assert found in (Reason.INPUT, Reason.MOTION)
