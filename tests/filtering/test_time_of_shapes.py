"""A shape counts from the time at which its object was first returned or set, in every list."""

import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from needs import needs

import hcbf_gym
from hcbf_gym import BatchFilter, models, wrappers
from hcbf_gym.barriers import Capsule, ConvexPolygon, Disc, Ellipse, Function, PlanarBarrier, Shapes
from hcbf_gym.models import Box, Estimate
from hcbf_robots import Command, Robot, VelocityFilter
from tests.worlds import OwnDisc, World

T = 0.05
ROOM = (40.0, 40.0)
"""So far away regions do not matter to the robot, which stays where it is [m]."""
MODELS = {
    "planar": models.DoubleIntegrator(),
    "drag": models.DoubleIntegrator(drag=0.5),
    "single": models.SingleIntegrator(),
    "unicycle": models.Unicycle(),
}


class DerivedDisc(Disc):
    """A user's own class of a built-in shape."""


def shapes(name, at, w):
    """Return a shape of each kind at a place, with a velocity."""
    x, y = at
    yield Disc(name, 1, at, 0.5, w)
    yield Ellipse(name, 1, at, (0.5, 0.3), 0.4, w)
    yield Capsule(name, 1, at, (x + 1.0, y), 0.3, w)
    yield ConvexPolygon(name, 1, ((x, y), (x + 1.0, y), (x, y + 1.0)), w)
    yield ConvexPolygon(name, 1, ((x, y), (x + 1.0, y), (x + 1.0, y + 1.0), (x, y + 1.0)), w)
    yield OwnDisc(name, 1, at, 0.5, w)
    yield DerivedDisc(name, 1, at, 0.5, w)


class Wrapped:
    """A filter around an environment, whose reader returns the list."""

    def __init__(self, model):
        self.env = World(model)
        self.env.listed = []
        plant = hcbf_gym.Plant(
            model, lambda env, *_: list(env.listed), lambda env, *_: env.x.copy(), period=T
        )
        late = isinstance(model, models.Unicycle)
        self.filtered = wrappers.SafetyFilter(self.env, plant=plant, allow_late_inputs=late)

    def begin(self, listed):
        self.env.listed = listed
        self.filtered.reset(seed=0)
        return self.step(listed)  # of the same time

    def step(self, listed):
        self.env.listed = listed
        *_, info = self.filtered.step(np.zeros(self.env.action_space.shape))
        return info["safety_filter"]


class Batch:
    """Three plants, of which the others began before; the last one counts."""

    def __init__(self, how):
        self.how, self.x = how, np.zeros((3, 4))
        self.filt = BatchFilter(Box.symmetric(5.0), T, 3)

    def _set(self, listed):
        if self.how == "one list":
            self.filt.set_scene(listed)
        else:
            self.filt.set_scene([list(listed) for _ in range(3)])

    def begin(self, listed):
        self._set(listed)
        self.filt.reset(x=self.x)
        for _ in range(7):
            self.filt(np.zeros((3, 2)), self.x)
        self.filt.reset(np.array([False, False, True]), x=self.x)
        return self.step(listed)  # of the same time

    def step(self, listed):
        self._set(listed)
        return self._last(self.filt(np.zeros((3, 2)), self.x)[1])

    def _last(self, report):
        return {name: value[2] for name, value in report.items()}


class Online:
    """A loop of the user's own, whose clock is any."""

    def __init__(self):
        robot = Robot(Command(0.8, 1.5, sideways=0.5))
        self.filt, self.now = VelocityFilter(robot, [], period=T, radius=0.0, margin=0.0), 1.7e9

    def begin(self, listed):
        self.filt.reset()
        return self.step(listed)

    def step(self, listed):
        self.filt.set_barriers(listed)
        _, report = self.filt.step(np.zeros(3), np.zeros(3), np.zeros(3), self.now)
        self.now += T
        return report


WAYS = {f"wrapper, {name}": lambda model=model: Wrapped(model) for name, model in MODELS.items()}
WAYS |= {f"batch, {how}": lambda how=how: Batch(how) for how in ("one list", "lists")}
WAYS |= {"online": Online}


@pytest.fixture(autouse=True)
def quiet():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def expected(one, age):
    """Return h of a shape at 0 so long after its object came."""
    return one.h(np.zeros(4), age)


@pytest.mark.parametrize("way", WAYS)
def test_a_new_object_is_where_it_is_put_and_the_same_object_moves_on(way):
    """Over random lists of objects of every kind that come, stay, change places and go."""
    rng, filt = np.random.default_rng(5), WAYS[way]()
    with_shapes = "wrapper" not in way or "planar" in way
    for episode in range(2):
        pool: list[Any] = []
        since: dict[int, int] = {}
        for step in range(12):
            for k in range(rng.integers(0, 3)):
                at, w = tuple(rng.uniform(5.0, 9.0, 2)), tuple(rng.uniform(-1.0, 1.0, 2))
                kinds = list(shapes(f"{episode} {step} {k}", at, w))
                pool.append(kinds[rng.integers(len(kinds))])
                if with_shapes and rng.random() < 0.3:
                    pool.append(Shapes("s", 1, "disc", [[*at, 0.5], [*at, 0.2]], w))
            pool = [pool[i] for i in rng.permutation(len(pool))]
            listed = [one for one in pool if rng.random() < 0.9] or [Disc("far", 1, ROOM, 1.0)]
            report = filt.step(listed) if step else filt.begin(listed)
            for one in listed:
                since.setdefault(id(one), step)
            known = {id(one) for one in listed}
            since = {key: when for key, when in since.items() if key in known}  # it went, and came
            pool = [one for one in pool if id(one) in known]
            found = iter(report["h"])
            for one in listed:
                age = (step - since[id(one)]) * T
                if isinstance(one, Shapes):
                    for x, y, r in ((*one_of(one, j),) for j in range(len(one))):
                        place = np.array([x, y]) + age * one.parameters[0, :2]
                        assert next(found) == pytest.approx(np.hypot(*place) - r, abs=1e-6)
                else:
                    assert next(found) == pytest.approx(expected(one, age), abs=1e-6)


def one_of(many, j):
    """Return centre and radius of a disc among many."""
    return many.parameters[j, 2:5].tolist()


@needs("jax")
@pytest.mark.parametrize("way", WAYS)
def test_a_reset_puts_all_back_and_a_function_reads_the_plants_clock(way):
    filt = WAYS[way]()
    disc = Disc("disc", 1, (5.0, 0.0), 0.5, (0.3, 0.0))
    clock = Function("clock", 1, lambda x, t: 40.0 + t + x[0])
    another = lambda x, t: 50.0 + t + x[0]  # noqa: E731
    for _ in range(2):
        assert filt.begin([disc, clock])["h"][:2] == pytest.approx([4.5, 40.0], abs=1e-6)
        for step in range(1, 5):
            later = Function("later", 1, another)
            report = filt.step([disc, clock] if step < 3 else [disc, later])
            t = step * T
            height = 40.0 if step < 3 else 50.0
            assert report["h"][:2] == pytest.approx([4.5 + 0.3 * t, height + t], abs=1e-5)


@pytest.mark.parametrize("kind", ["one list", "arrays"])
def test_a_scene_counts_from_when_it_was_set(kind):
    filt, x = BatchFilter(Box.symmetric(5.0), T, 2), np.zeros((2, 4))
    w = np.array([0.4, 0.0])

    def put(at):
        if kind == "one list":
            filt.set_scene([Disc("a", 1, (at, 0.0), 0.5, tuple(w))])
        else:
            filt.set_scene([Shapes("a", 1, "disc", [[[at, 0.0, 0.5]]] * 2, w)])

    put(5.0)
    filt.reset(x=x)
    filt.reset(np.array([True, False]), x=x)
    at, since = 5.0, 0
    for step in range(7):
        if step in (3, 5):
            at, since = 5.0 + step, step
            put(at)
        _, report = filt(np.zeros((2, 2)), x)
        assert report["h"] == pytest.approx(at + 0.4 * (step - since) * T - 0.5, abs=1e-9)


def test_a_static_list_moves_on_over_a_join_where_the_plant_has_a_clock():
    disc, env = Disc("disc", 1, (5.0, 0.0), 0.5, (0.5, 0.0)), World(MODELS["planar"])
    env.time = 0.0

    def state(env, *_):
        return Estimate(env.x.copy(), env.time)

    plant = hcbf_gym.Plant(MODELS["planar"], [disc], state, period=T)
    filtered = wrappers.SafetyFilter(env, plant=plant)
    for start in (0.0, 7.0):  # a clock that a reset does not put back
        env.time = start
        _, info = filtered.reset()
        assert info["safety_filter"]["h"][0] == pytest.approx(4.5)
        env.time = start + 2.0
        _, info = filtered.join(env.x.copy(), {})
        assert info["safety_filter"]["h"][0] == pytest.approx(5.5)
        env.time = start + 2.0 + T
        *_, info = filtered.step(np.zeros(2))
        assert info["safety_filter"]["h"][0] == pytest.approx(5.5 + 0.5 * T)


def test_a_filter_that_takes_anothers_place_takes_its_times():
    robot = Robot(Command(0.8, 1.5, sideways=0.5))
    disc = Disc("disc", 1, (5.0, 0.0), 0.5, (0.5, 0.0))
    before = VelocityFilter(robot, [disc], period=T, radius=0.0)
    still = np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(5):
        before.step(*still, 100.0 + k * T)
    after = VelocityFilter(robot, [disc], period=T, radius=0.0)
    after.step(*still, 100.0 + 5 * T)
    after.go_on_from(before)
    _, report = after.step(*still, 100.0 + 6 * T)
    assert report["h"][0] == pytest.approx(4.5 + 0.5 * 6 * T)
    after.program = "h-cbf-qp"
    _, report = after.step(*still, 100.0 + 7 * T)
    assert report["h"][0] == pytest.approx(4.5 + 0.5 * 7 * T)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("scenario", ["random-moving", "random"])
def test_the_shipped_scenes_count_from_the_reset(scenario, seed):
    """As they did before: p₀ + w t with the episode's t, also of a filter that joins later."""
    env = gym.make("HCBF-Regions-v0", scenario=scenario)
    filtered, late = wrappers.SafetyFilter(env), None
    observation, info = filtered.reset(seed=seed)
    inner: Any = env.unwrapped
    for step in range(60):
        x, t = inner.estimate.x.copy(), inner.time
        if step == 30:
            late = wrappers.SafetyFilter(env)
            _, answers = late.join(observation, dict(info))
            reported = answers["safety_filter"]["h"]
            np.testing.assert_allclose(reported, [one.h(x, t) for one in inner.barriers], atol=1e-9)
        observation, *_, info = (late or filtered).step(np.array([1.0, 0.5]))
        reported = info["safety_filter"]["h"]
        np.testing.assert_allclose(reported, [one.h(x, t) for one in inner.barriers], atol=1e-9)
    moving = [one for one in inner.scenario.barriers if isinstance(one, PlanarBarrier)]
    assert any(one.frame_velocity.any() for one in moving) == (scenario == "random-moving")
