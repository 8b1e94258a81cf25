"""Any values: they are refused or braked, nothing unknown passes, and no process ends."""

import contextlib
import dataclasses
import functools
import warnings
from typing import Any

import gymnasium as gym
import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_np

import hcbf_gym
from benchmarks.suites.mutations import mutated
from hcbf_gym import Estimate, HcbfError, barriers, models, scenarios, wrappers
from hcbf_gym.envs.regions_vector import RegionsVectorEnv
from hcbf_gym.programs import FilterStatus
from tests.worlds import World

PERIOD = 0.02
GOOD = np.array([0.1, -0.2, 0.4, 0.3])
WALL = barriers.HalfPlane("wall", 1, (0.0, 1.0), -3.0)
CORES = {
    "compiled": (models.DoubleIntegrator(), None),
    "daqp": (models.DoubleIntegrator(), "daqp"),
    "any model": (models.DoubleIntegrator(drag=0.1), None),
}


def fuzzed(count, *strategies):
    """Run a test with so many values; what is refused in words is as it should be."""

    def decorate(test):
        @functools.wraps(test)
        def judged(**drawn):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                with contextlib.suppress(HcbfError):
                    test(**drawn)

        phases = [Phase.generate, Phase.shrink]
        limits = settings(max_examples=count, database=None, phases=phases,
                          suppress_health_check=list(HealthCheck))  # fmt: skip
        return limits(given(*strategies)(judged))

    return decorate


numbers = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(-3.0, 3.0),
    st.sampled_from([np.nan, np.inf, -np.inf, 0.0, 1e308, -1e200, 1e-300]),
)
dtypes = st.sampled_from(
    [np.float64, np.float32, np.float16, np.int64, np.int8, np.bool_, np.complex128, "U3", object]
)
shapes = st.one_of(
    st.sampled_from([(4,), (4,), (1, 4), (2,), (3,), (2, 2), (4, 4), (0,), (), (2, 4), (1, 1, 4)]),
    st_np.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=5),
)


@st.composite
def arrays(draw):
    made = draw(st_np.arrays(np.float64, draw(shapes), elements=numbers))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return made.astype(draw(dtypes))


values = st.one_of(
    st.none(),
    st.booleans(),
    st.text(max_size=4),
    st.integers(),
    st.just(10**400),
    numbers,
    st.complex_numbers(),
    st.lists(numbers, max_size=5),
    st.lists(st.lists(numbers, max_size=3), max_size=3),
    st.dictionaries(st.text(max_size=2), numbers, max_size=2),
    arrays(),
)
estimates = st.one_of(
    values,
    st.builds(
        Estimate,
        st.one_of(st.just(GOOD), values),
        st.one_of(st.none(), values),
        st.one_of(st.none(), values),
        st.one_of(st.none(), values),
        st.one_of(st.none(), values),
        st.none(),
        st.one_of(st.none(), values),
        st.one_of(st.none(), st.integers(-3, 20), values),
        st.one_of(st.none(), st.just(0.02), values),
    ),
)


class Jets(barriers.Barrier):
    """A user's own barrier that returns what it is given."""

    answer: Any = None

    def jet(self, x, t=0.0):
        return self.answer


def own(answer):
    barrier = Jets("own", 1)
    object.__setattr__(barrier, "answer", answer)
    return barrier


jets = st.one_of(
    values,
    st.builds(
        barriers.Jet,
        numbers,
        st.one_of(st_np.arrays(np.float64, 4, elements=numbers), values),
        st.one_of(st_np.arrays(np.float64, (4, 4), elements=numbers), values),
        numbers,
        st.one_of(st_np.arrays(np.float64, 4, elements=numbers), values),
        numbers,
    ),
)


def refused(make):
    """What a constructor returns, or None where it refuses its arguments."""

    def build(*arguments):
        try:
            return make(*arguments)
        except HcbfError:
            return None

    return build


listed = st.one_of(
    values,
    st.lists(
        st.one_of(
            st.builds(refused(barriers.Disc), st.just("d"), values, values, values, values),
            st.builds(refused(barriers.Disc), st.just("d"), st.integers(1, 9), values, numbers),
            st.builds(refused(barriers.HalfPlane), st.just("p"), st.integers(1, 9), values, values),
            st.builds(refused(barriers.Ellipse), st.just("e"), st.just(1), values, values, values),
            st.builds(refused(barriers.ConvexPolygon), st.just("c"), st.just(1), values, values),
            st.builds(refused(barriers.SpeedLimit), st.just("s"), st.just(1), values, values),
            st.builds(
                refused(barriers.Shapes),
                st.just("many"),
                st.integers(-1, 5),
                st.sampled_from(["disc", "half-plane", "convex-polygon", "cube"]),
                st.one_of(values, arrays()),
                st.one_of(st.just((0.0, 0.0)), values),
            ),
            st.builds(own, jets),
            st.just(WALL),
            values,
        ),
        max_size=4,
    ),
)


class Point(World):
    """A point at rest; what matters is what the filter gets."""

    def step(self, action):
        assert np.isfinite(action).all()
        assert (np.abs(action) <= 5.0 + 1e-9).all()
        return super().step(action)


def point():
    return Point(start=GOOD)


def is_sound(reported) -> bool:
    """Whether a filter may accept what it gets, judged independently."""
    estimate = reported if isinstance(reported, Estimate) else Estimate(reported)

    def fits(value, *allowed):
        try:
            array = np.asarray(value)
        except (TypeError, ValueError):
            return False
        if array.dtype.kind not in "fiu" or array.shape not in allowed:
            return False
        return bool(np.isfinite(array.astype(np.float64)).all())

    optional = (
        (estimate.time, ((), (1,))),
        (estimate.covariance, ((4, 4), (1, 4, 4))),
        (estimate.model, ((4,), (1, 4))),
        (estimate.lag, ((4,), (1, 4))),
        (estimate.age, ((), (1,))),
        (estimate.fault, ((), (1,))),
        (estimate.elapsed, ((), (1,))),
    )
    sound = fits(estimate.x, (4,), (1, 4))
    return sound and all(value is None or fits(value, *allowed) for value, allowed in optional)


def drive(env, reported, steps=3) -> list:
    """Reset and step an environment; return the reports."""
    reports = [env.reset(seed=0)[1]["safety_filter"]]
    reports += [env.step(np.array([3.0, -2.0]))[4]["safety_filter"] for _ in range(steps)]
    for report in reports:
        assert np.isfinite(report["u_safe"]).all()
    return reports


@fuzzed(128, estimates, st.booleans(), st.sampled_from(sorted(CORES)))
def test_states(reported, from_the_start, core):
    model, solver = CORES[core]
    sees = iter([reported] * 9 if from_the_start else [GOOD, GOOD, *[reported] * 7])
    plant = hcbf_gym.Plant(model, (WALL,), lambda *_: next(sees), period=PERIOD, max_age=0.1)
    env = wrappers.SafetyFilter(point(), plant=plant, solver=solver)
    reports = drive(env, reported)
    if not is_sound(reported):
        assert reports[-1]["status"] == FilterStatus.BACKUP, reports[-1]
        assert reports[-1]["reason"] > 0


@fuzzed(72, listed, st.booleans(), st.sampled_from(sorted(CORES)))
def test_barriers(reported, reader, core):
    model, solver = CORES[core]
    given_barriers = (lambda *_: reported) if reader else reported
    plant = hcbf_gym.Plant(model, given_barriers, lambda *_: GOOD.copy(), period=PERIOD)
    reports = drive(wrappers.SafetyFilter(point(), plant=plant, solver=solver), reported)
    if not isinstance(reported, list | tuple) or any(b is None for b in reported):
        assert reports[-1]["status"] == FilterStatus.BACKUP


SCENES = ("paper-simulation", "paper-experiment", "random-moving", "random-wide")


STARTS = st.dictionaries(st.sampled_from(["scenario", "start", "other"]), values, max_size=2)


@fuzzed(
    48, st.sampled_from(SCENES), st.integers(0, 2**32 - 1), STARTS,
    st.sampled_from(["argument", "reset", "batch", "A1", "options"]),
)  # fmt: skip
def test_scenes(name, seed, options, filt):
    rng = np.random.default_rng(seed)
    reported = mutated(scenarios.make(name, rng).to_dict(), rng)
    u = np.array([3.0, -2.0])
    if filt == "A1":
        env = wrappers.SafetyFilter(gym.make("HCBF-A1Regions-v0", scenario=reported))
    elif filt == "batch":
        env = gym.make_vec("HCBF-Regions-v0", num_envs=2, scenario=reported)
        env, u = wrappers.VectorSafetyFilter(env), np.stack([u, -u])
    else:
        start = reported if filt == "argument" else "random"
        env = wrappers.SafetyFilter(gym.make("HCBF-Regions-v0", scenario=start))
    asked = {"reset": {"scenario": reported}, "options": options}.get(filt)
    observation, info = env.reset(seed=0, options=asked)
    for _ in range(3):
        observation, _, _, _, info = env.step(u)
    assert np.isfinite(info["safety_filter"]["u_safe"]).all()
    assert np.isfinite(observation).all()


class ReportingBatch(RegionsVectorEnv):
    """This package's batch with malformed states."""

    reported: Any = None

    @property
    def plant(self):
        return dataclasses.replace(super().plant, state=lambda *_: self.reported)


@fuzzed(16, estimates)
def test_states_of_a_batch(reported):
    envs = ReportingBatch(2, scenario="random")
    envs.reported = reported
    filtered = wrappers.VectorSafetyFilter(envs)
    filtered.reset(seed=0)
    for _ in range(2):
        _, _, _, _, info = filtered.step(np.full((2, 2), 3.0))
    assert np.isfinite(info["safety_filter"]["u_safe"]).all()
    estimate = reported if isinstance(reported, Estimate) else Estimate(reported)
    if getattr(estimate.x, "shape", None) != (2, 4):
        assert (info["safety_filter"]["status"] == FilterStatus.BACKUP).all()


places_or_values = st.one_of(
    st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0)), st.just((0.0, -4.0)), values
)


@fuzzed(
    32,
    places_or_values,
    st.one_of(st.just(GOOD), estimates),
    st.one_of(st.none(), values),
    st.sampled_from(["geodesic", "local", {"kind": "geodesic", "through": 2}]),
    st.sampled_from([None, "daqp"]),
    st.integers(0, 2),
)
def test_goals_extents_and_states_under_guidance(goal, reported, extent, guidance, solver, resets):
    """Guidance before a reset, after one that failed, and with malformed goals and states."""
    plant = hcbf_gym.Plant(
        models.DoubleIntegrator(),
        (WALL,),
        lambda *_: reported,
        period=PERIOD,
        goal=goal,
        extent=extent,
    )
    env = wrappers.SafetyFilter(point(), plant=plant, guidance=guidance, solver=solver)
    for _ in range(resets):
        with contextlib.suppress(HcbfError):
            env.reset(seed=0)
    for _ in range(3):
        report = env.step(np.array([3.0, -2.0]))[4]["safety_filter"]
        assert np.isfinite(report["u_safe"]).all()
        assert is_sound(reported) or report["status"] == FilterStatus.BACKUP
