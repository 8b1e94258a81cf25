"""When a filter raises an alarm, whatever its model is."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hcbf_gym
from hcbf_gym import Estimate
from hcbf_gym.models import (
    Box,
    ControlAffine,
    DoubleIntegrator,
    KinematicBicycle,
    Reason,
    SingleIntegrator,
    Unicycle,
)
from hcbf_gym.wrappers import SafetyFilter
from tests.worlds import World

T = 0.02
SEEDS = st.integers(0, 2**32 - 1)


def pendulum():
    """A pendulum about its upper rest, in NumPy."""
    return ControlAffine(
        lambda x: np.array([x[1], 15.0 * np.sin(x[0])]), lambda x: np.array([[0.0], [3.0]]), 2, 1
    )


def quadrotor():
    """Planar: x, z, tilt and their rates; thrust and torque, each per mass and inertia."""

    def g(x):
        push = np.array([[-np.sin(x[2]), 0.0], [np.cos(x[2]), 0.0], [0.0, 50.0]])
        return np.vstack([np.zeros((3, 2)), push])

    return ControlAffine(lambda x: np.array([*x[3:], 0.0, -9.81, 0.0]), g, n=6, n_u=2)


def coupled():
    """Four velocities, which four inputs drive together: g has no orthogonal columns."""
    shares = np.array([[1.0, 0.9, 0.8, 0.7], [0.9, 1.0, 0.4, 0.2], [0.8, 0.4, 1.0, 0.1],
                       [0.7, 0.2, 0.1, 1.0]])  # fmt: skip
    return ControlAffine(
        lambda x: np.concatenate([x[4:], np.zeros(4)]),
        lambda x: np.vstack([np.zeros((4, 4)), shares]),
        n=8,
        n_u=4,
    )


PLANTS = {
    "point": (DoubleIntegrator(), Box.symmetric(5.0)),
    "boat": (DoubleIntegrator(drag=0.5), Box.symmetric(2.0)),
    "one input": (DoubleIntegrator(1), Box.symmetric(2.0, 1)),
    "three inputs": (DoubleIntegrator(3), Box.symmetric(2.0, 3)),
    "velocities": (SingleIntegrator(), Box.symmetric(1.0)),
    "arm": (SingleIntegrator(6), Box.symmetric(0.5, 6)),
    "unicycle": (Unicycle(), Box([-1.0, -2.0], [1.0, 2.0])),
    "bicycle": (KinematicBicycle(), Box([-3.0, -0.5], [3.0, 0.5])),
    "pendulum": (pendulum(), Box.symmetric(2.0, 1)),
    "coupled inputs": (coupled(), Box.symmetric(2.0, 4)),
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
    if name == "coupled inputs":
        return u - x[4:]
    if name in ("point", "three inputs", "one input"):
        return u - x[u.size :]
    return u


def exact(model, x, u, dt):
    return model.step(x, u, dt)


def semi_implicit(model, x, u, dt):
    """As physics engines integrate: rates first, then what moves by the new ones."""
    first = x + dt * (model.f(x) + model.g(x) @ u)
    driven = (np.abs(model.g(x)) > 0.0).any(axis=1)
    new = np.where(driven, first, x)
    return np.where(driven, first, x + dt * (model.f(new) + model.g(new) @ u))


class Integrated(World):
    """A plant that is integrated by a function of model, x, u and dt."""

    def advance(self, u):
        return self.integrate(self.model, self.x, u, T)


def alarm(name, integrate=exact, sense=None, spread=None, seed=0, count=500, drive=None):
    """The first alarm of a run and the sample at which it came; (NONE, count) without one."""
    model, u_set = PLANTS[name]
    past, asked = [], inputs(u_set, seed, count)

    def state(env, *_):
        past.append(env.x.copy())
        x = env.x if sense is None else sense(past, len(past) - 1)
        return Estimate(np.array(x), time=T * (len(past) - 1), covariance=spread)

    plant = hcbf_gym.Plant(model, lambda *_: [], state, u_set, period=T)
    env = Integrated(model, T, limit=99.0)
    env.integrate = integrate
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = SafetyFilter(env, plant=plant)
        env.reset(seed=0)
        past.clear()
        for k in range(count):
            x = env.unwrapped.x
            u = u_set.project(balance(name, x, asked[k]) if drive is None else drive(k))
            report = env.step(u)[4]["safety_filter"]
            if report["reason"]:
                return Reason(int(report["reason"])), k
    return Reason.NONE, count


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("integrate", [exact, semi_implicit])
@settings(max_examples=5)
@given(seed=SEEDS)
def test_a_plant_that_is_its_model_raises_no_alarm(name, integrate, seed):
    assert alarm(name, integrate, seed=seed, count=300) == (Reason.NONE, 300)


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("noise", [0.001, 0.02])
def test_noise_that_is_declared_raises_no_alarm(name, noise):
    model, rng = PLANTS[name][0], np.random.default_rng(0)
    sizes = np.full(model.n, noise)
    if name == "point":  # whose input is compared without what is declared of the velocity
        sizes[2:] = 1e-5
    found = alarm(
        name, sense=lambda past, k: past[-1] + rng.normal(0.0, sizes), spread=np.diag(sizes**2)
    )
    assert found == (Reason.NONE, 500)


WRONG = {
    "frozen": lambda past, k: past[0],
    "swapped": lambda past, k: past[-1][::-1],
    "half": lambda past, k: 0.5 * past[-1],
    "double": lambda past, k: 2.0 * past[-1],
    "a fifth more": lambda past, k: 1.2 * past[-1],
    "late": lambda past, k: past[max(0, k - 5)],
}


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("name", ["point", "boat"])
@pytest.mark.parametrize("integrate", [exact, semi_implicit])
def test_a_position_that_does_not_move_as_the_velocity_does_is_seen_within_half_a_second(
    wrong, integrate, name
):
    def sense(past, k):
        return np.concatenate([WRONG[wrong]([x[:2] for x in past], k), past[-1][2:]])

    speeds_up = lambda k: np.array([3.0, 1.0]) * (10 <= k < 22)  # noqa: E731
    found, k = alarm(name, integrate, sense, drive=speeds_up)
    assert found == Reason.MOTION
    assert (k - 10) * T <= 0.5


@pytest.mark.parametrize("wrong", WRONG)
def test_so_it_is_where_the_input_is_the_velocity(wrong):
    drive = lambda k: np.array([0.9, 0.3]) * (k >= 10)  # noqa: E731
    found, k = alarm("velocities", sense=WRONG[wrong], drive=drive)
    assert found in (Reason.MOTION, Reason.INPUT)
    assert (k - 10) * T <= 0.5


def test_a_velocity_of_another_is_seen():
    drive = lambda k: np.array([3.0, 1.0]) * (10 <= k < 22)  # noqa: E731
    found, k = alarm("point", sense=lambda past, k: [*past[-1][:2], 0.0, 0.0], drive=drive)
    assert found in (Reason.MOTION, Reason.INPUT)
    assert (k - 10) * T <= 0.5


def test_a_heading_that_is_wrapped_is_no_jump():
    def wrapped(past, k):
        return np.array([*past[-1][:2], np.remainder(past[-1][2] + np.pi, 2 * np.pi) - np.pi])

    turning = np.array([0.5, 2.0])
    assert alarm("unicycle", sense=wrapped, drive=lambda k: turning)[0] == Reason.NONE


def scaled(share):
    return lambda model, x, u, dt: model.step(x, share * u, dt)


@pytest.mark.parametrize("share", [2.0, -1.0])
@pytest.mark.parametrize("name", ["point", "boat", "pendulum", "bicycle"])
def test_an_input_that_is_doubled_or_turned_is_seen(name, share):
    assert alarm(name, scaled(share))[0] in (Reason.INPUT, Reason.MOTION)


@pytest.mark.parametrize("share", [0.0, 0.5, 2.0, -1.0])
@pytest.mark.parametrize("name", ["point", "boat", "velocities"])
def test_a_share_of_the_input_is_seen_within_a_second(name, share):
    rng = np.random.default_rng(0)
    found, k = alarm(name, scaled(share), drive=lambda k: rng.uniform(0.3, 1.0, 2))
    assert found in (Reason.INPUT, Reason.MOTION)
    assert k * T <= 1.0


def applied(u, really):
    """The first alarm of the point where `really[k]` is applied in the place of `u[k]`."""
    steps = iter(really)
    return alarm(
        "point", lambda model, x, u, dt: model.step(x, next(steps), dt), count=len(u),
        drive=lambda k: u[k],
    )[0]  # fmt: skip


def wanted(seed, count=200):
    rng = np.random.default_rng(seed)
    held = rng.uniform(-5.0, 5.0, (count // 10, 2)) * rng.random((count // 10, 1))
    return np.repeat(held, 10, axis=0)


@given(SEEDS, st.floats(0.0, 0.3))
def test_an_environment_that_applies_u_nearly_is_no_alarm(seed, off):
    u, rng = wanted(seed), np.random.default_rng(seed)
    error = rng.uniform(-off, off, u.shape) * np.linalg.norm(u, axis=1, keepdims=True)
    assert applied(u, u + error) == Reason.NONE


EXACT_PLANTS_MISS = {
    "a gain that is cut off": lambda u: (u, np.clip(2.0 * u, -5.0, 5.0)),
    "a gain": lambda u: (0.1 * u + 0.3, 0.2 * u + 0.6),
    "a delay": lambda u: (u, np.vstack([np.zeros((10, 2)), u[:-10]])),
    "a hold": lambda u: (u, np.repeat(u[::25], 25, axis=0)),
    "every third": lambda u: (0.1 * u + 0.6, every(u, 3, 1, -1.0) * (0.1 * u + 0.6)),
    "some": lambda u: (0.1 * u + 0.6, every(u, 20, 6, 0.6) * (0.1 * u + 0.6)),
}


def every(u, period, count, gain):
    """(N, 1) the gain in so many of each period's steps, else 1."""
    return np.where(np.arange(len(u))[:, None] % period < count, gain, 1.0)


@pytest.mark.parametrize("what", EXACT_PLANTS_MISS)
@settings(max_examples=30)
@given(seed=SEEDS)
def test_what_an_exact_plant_misses_of_its_inputs_is_an_alarm(what, seed):
    assert applied(*EXACT_PLANTS_MISS[what](wanted(seed))) == Reason.INPUT


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_noise_at_rest_is_no_alarm(noise):
    rng = np.random.default_rng(0)
    u = rng.uniform(-0.1, 0.1, (300, 2))
    assert applied(u, u + rng.normal(0.0, noise, u.shape)) == Reason.NONE


@pytest.mark.parametrize("name", ["coupled inputs", "three inputs"])
@pytest.mark.parametrize(("gain", "found"), [(0.57, Reason.NONE), (0.53, Reason.INPUT)])
def test_an_input_is_missed_from_the_same_share_on_however_inputs_are_coupled(name, gain, found):
    def weaker(model, x, u, dt):
        return model.step(x, gain * u, dt)

    steady = lambda k: np.full(PLANTS[name][1].n_u, 0.4) * (-1.0) ** (k // 25)  # noqa: E731
    assert alarm(name, weaker, drive=steady, count=200)[0] == found
