"""A warning that the filter brakes names what exactly is wrong, on every model."""

import math
import warnings

import numpy as np
import pytest

from hcbf_gym import Estimate, Plant, wrappers
from hcbf_gym.barriers import Barrier, Disc, Jet
from hcbf_gym.models import DoubleIntegrator, Reason
from hcbf_gym.programs import FilterStatus
from tests.worlds import World

PERIOD = 0.05
FAR = Disc("far", 1, center=(50.0, 0.0), radius=1.0)
MODELS = {"planar": DoubleIntegrator(), "drag": DoubleIntegrator(drag=0.5)}


def answers(model, estimates, barriers=(FAR,), **options):
    """Return the warnings about steps with these estimates, functions of x and time."""
    estimates = [lambda x, t: Estimate(x, t), *estimates]
    steps = iter([lambda x, t: Estimate(x, t), *estimates])
    count = iter(range(100))

    def state(env, x, info):
        return next(steps)(x, PERIOD * next(count))

    plant = Plant(model, list(barriers), state, period=PERIOD, **options)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        env = wrappers.SafetyFilter(World(model, PERIOD), plant=plant)
        _, info = env.reset()
        for _ in estimates:
            *_, info = env.step(np.zeros(2))
    report = info["safety_filter"]
    assert report["status"] == FilterStatus.BACKUP
    return Reason(int(report["reason"])), " ".join(str(one.message) for one in caught)


def at(x, k, value):
    """Return a state with one entry changed."""
    x = x.copy()
    x[k] = value
    return x


CASES = {
    "NaN": (lambda x, t: Estimate(at(x, 2, math.nan), t), Reason.STATE, "x[2] is nan"),
    "far": (lambda x, t: Estimate(at(x, 0, 2e4), t), Reason.STATE, "x[0] is 20000, expected"),
    "shape": (lambda x, t: Estimate(x[:3], t), Reason.STATE, "numbers of shape (4,)"),
    "lag": (
        lambda x, t: Estimate(x, t, None, x, at(x, 1, math.inf)), Reason.STATE, "lag[1] is inf",
    ),
    "covariance": (
        lambda x, t: Estimate(x, t, np.diag([1.0, -1.0, 0.0, 0.0])), Reason.STATE,
        "covariance: got",
    ),
    "elapsed": (lambda x, t: Estimate(x, t, elapsed=-1.0), Reason.STATE, "elapsed: got -1 s"),
    "old": (lambda x, t: Estimate(x, t, age=0.35), Reason.AGE, "0.35 s old, at most 0.1"),
    "ahead": (lambda x, t: Estimate(x, t, age=-0.2), Reason.AGE, "0.20 s ahead of the clock"),
    "missing": (lambda x, t: Estimate(x, t, age=math.inf), Reason.AGE, "the stamp of the state"),
    "back": (lambda x, t: Estimate(x, t - 1.0), Reason.CLOCK, "got -0.9 s after 0.05 s"),
    "no time": (lambda x, t: Estimate(x, math.nan), Reason.CLOCK, "got nan"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("model", MODELS)
def test_the_state_the_age_and_the_clock_name_their_part(model, case):
    estimate, reason, part = CASES[case]
    seen, text = answers(MODELS[model], [estimate], max_age=0.1)
    assert seen == reason
    assert part in text


class Broken(Barrier):
    """A wall whose jet has one part that is not finite from x = (0, 0, …) on."""

    def jet(self, x, t=0.0):
        parts = {"h": 3.0 - x[0], "gradient": -np.eye(4)[0], "hessian": np.zeros((4, 4))}
        if self.name in parts and not x.any():
            parts[self.name] = parts[self.name] * math.nan
        if self.name == "raises" and not x.any():
            raise ValueError("no data")
        if self.name == "shape" and not x.any():
            parts["gradient"] = np.zeros(3)
        h, gradient, hessian = parts.values()
        return Jet(float(h), gradient, hessian, 0.0, np.zeros(4), 0.0)


@pytest.mark.parametrize(
    ("name", "part"),
    [("h", "h is nan"), ("raises", "it raised ValueError: no data")],
)
@pytest.mark.parametrize("model", MODELS)
def test_barriers_name_the_one_its_part_and_the_state(model, name, part):
    seen, text = answers(MODELS[model], [lambda x, t: Estimate(x, t)], [FAR, Broken(name, 2)])
    assert seen == Reason.BARRIERS
    for words in (f"condition 1, {name!r} of rank 2", part, "x = [0.0, 0.0, 0.0, 0.0]"):
        assert words in text


@pytest.mark.parametrize("model", MODELS)
def test_an_error_of_a_row_is_its_cause_where_the_barrier_itself_raises_none(model):
    seen, text = answers(MODELS[model], [lambda x, t: Estimate(x, t)], [FAR, Broken("shape", 2)])
    assert seen == Reason.BARRIERS
    assert "shape: got the jet" in text
    assert "x = [0.0, 0.0, 0.0, 0.0]" in text


@pytest.mark.parametrize("name", ["gradient", "hessian"])
@pytest.mark.parametrize("model", MODELS)
def test_a_derivative_that_is_nan_at_one_state_alone_is_taken_beside_it(model, name):
    plant = Plant(MODELS[model], [Broken(name, 1)], lambda env, x, info: x, period=PERIOD)
    env = wrappers.SafetyFilter(World(MODELS[model], PERIOD), plant=plant)
    with pytest.warns(UserWarning, match="beside"):
        _, info = env.reset()
    assert info["safety_filter"]["reason"] == Reason.NONE
