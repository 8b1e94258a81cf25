"""Arguments stay the caller's, who may change them; so do returned values."""

import itertools
from collections import OrderedDict, deque
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import BatchFilter, Plant, models, wrappers
from hcbf_gym.barriers import BarrierSet, Disc, GeneralRows, LinearClassK, LogClassK
from hcbf_gym.barriers.many import Several
from hcbf_gym.barriers.prepared import Prepared, prepare_scenes
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models import Coverage
from hcbf_robots import VelocityFilter
from hcbf_robots.maps import Grid, MapClass, RankedMap, Scan
from tests.worlds import OwnDisc, World

MODELS = (models.DoubleIntegrator(), models.SingleIntegrator(), models.Unicycle())


def post(at):
    return Disc("post", 1, center=(at, 0.0), radius=0.5)


class Post(Several):
    """A post that is moved in place, and whose list of conditions stays the same object."""

    conditions = ()

    def __init__(self, at=30.0):
        self.conditions = [post(at)]

    def move(self, at):
        self.conditions[0] = post(at)


class Pair(NamedTuple):
    """Barriers of a plant, by name."""

    first: object


def still(model=MODELS[0]):
    return World(model)


def moving():
    return World(period=0.02)


def single(barriers, model=MODELS[0]):
    plant = Plant(model, barriers, lambda env, *_: env.x.copy(), period=0.02)
    env = wrappers.SafetyFilter(still(model), plant=plant, allow_late_inputs=True)
    env.reset(seed=0)
    return lambda: env.step(np.zeros(model.n_u))[4]["safety_filter"]["h"][-1]


def batch(barriers):
    filt = BatchFilter(models.Box.symmetric(3.0), 0.02, 2)
    filt.set_scene(barriers)
    filt.reset(x=np.zeros((2, 4)))
    return lambda: filt(np.zeros((2, 2)), np.zeros((2, 4)))[1]["h"][1, -1]


def loop(barriers):
    safe, times = VelocityFilter("cart", barriers, period=0.02), itertools.count()
    return lambda: safe.step((0.0, 0.0), *np.zeros((2, 3)), 0.02 * next(times))[1]["h"][-1]


INPUTS = {
    "a list": lambda one: single([one]),
    "a list, any model": lambda one: single([one], MODELS[1]),
    "a list, a vehicle": lambda one: single([one], MODELS[2]),
    "a reader": lambda one: single(lambda *_: [one]),
    "a list for a batch": lambda one: batch([one]),
    "lists for a batch": lambda one: batch([[one], [one]]),
    "deques for a batch": lambda one: batch([deque([one]), deque([one])]),
    "tuples with names for a batch": lambda one: batch([Pair(one), Pair(one)]),
    "a loop": lambda one: loop([one]),
}


@pytest.mark.filterwarnings("ignore:safety filter")
@pytest.mark.parametrize("given", INPUTS)
def test_a_source_of_barriers_that_is_moved_in_place_is_seen(given):
    one = Post()
    step = INPUTS[given](one)
    step()
    far = step()
    one.move(10.0)
    assert far - step() == pytest.approx(20.0)


class Broken(Post):
    """A post whose sensor fails."""

    error = None

    @property
    def conditions(self):
        if self.error is not None:
            raise self.error
        return self.seen

    @conditions.setter
    def conditions(self, seen):
        self.seen = seen


@pytest.mark.filterwarnings("ignore:safety filter")
@pytest.mark.parametrize("error", [ValueError("broken"), OSError("unplugged")])
@pytest.mark.parametrize("given", INPUTS)
def test_a_source_of_barriers_that_fails_stops_the_robot_until_it_is_back(given, error):
    one = Broken()
    step = INPUTS[given](one)
    before = step()
    one.error = error
    assert np.isnan(step())  # nothing is accepted: h is unknown
    one.error = None
    assert step() == before


@pytest.mark.filterwarnings("ignore:safety filter")
@pytest.mark.parametrize("given", INPUTS)
def test_a_source_of_barriers_holds_no_other_source(given):
    one = Post()
    one.conditions[0] = Post()
    if given == "a reader":  # which may say better later
        one.conditions[0] = post(30.0)
        step = INPUTS[given](one)
        one.conditions[0] = Post()
        assert np.isnan(step())
        return
    with pytest.raises(InvalidInputError, match=r"Post object.*expected"):
        INPUTS[given](one)()


@pytest.mark.filterwarnings("ignore:safety filter")
@pytest.mark.parametrize("inner", [deque, list])
def test_what_a_list_of_lists_holds_is_seen(inner):
    scenes = [inner([post(30.0)]), inner([post(30.0)])]
    plant = Plant(
        MODELS[0], lambda *_: scenes, lambda envs, *_: np.zeros((2, 4)), period=0.02,
        input_set=models.Box.symmetric(3.0),
    )  # fmt: skip
    envs = wrappers.VectorSafetyFilter(gym.vector.SyncVectorEnv(2 * [still]), plant=plant)
    envs.reset(seed=0)
    scenes[1][0] = post(10.0)
    h = envs.step(np.zeros((2, 2)))[4]["safety_filter"]["h"]
    np.testing.assert_allclose(h[:, -1], [29.5, 9.5])


def wall(at):
    """Return a map whose cells are occupied at some x [m]."""
    cells = np.zeros((20, 80), dtype=np.bool_)
    cells[:, round(at / 0.1)] = True
    return RankedMap(
        Grid(0.1, (0.0, -1.0, 0.0), cells.shape), (MapClass("wall", 1, "keepout", cells),)
    )


def test_a_scene_is_set_in_a_part_of_a_set_alone():
    one = BarrierSet([[wall(2.0)], [wall(2.0)]])
    some = one.of(np.array([True, False]))
    before = some.values(*HERE(some)), one.values(*HERE(one))
    some.set_scene(0, [wall(5.0)])
    after = some.values(*HERE(some)), one.values(*HERE(one))
    assert after[0][0] != before[0][0]
    np.testing.assert_array_equal(after[0][1:], before[0][1:])
    np.testing.assert_array_equal(after[1], before[1])


def HERE(some):  # noqa: N802
    count = len(some.kind)
    return np.tile([0.5, 0.0, 0.0, 0.0], (count, 1)), np.zeros(count)


def test_rows_that_filters_in_two_threads_share_are_each_ones_own(monkeypatch):
    """Whatever the other requests between two lines."""
    rows = GeneralRows(MODELS[0], LogClassK(), LinearClassK(2.0))
    mine, others = [(OwnDisc("mine", 1),)], [(OwnDisc("another's", 1),)]
    compare = Prepared.is_of

    def interrupted(one, other):
        found = compare(one, other)
        rows._latest = prepare_scenes(BarrierSet(others), rows.functions, rows.reach)
        return found

    rows.prepare(mine)
    monkeypatch.setattr(Prepared, "is_of", interrupted)
    for _ in range(3):
        assert rows.prepare(mine).barrier_set.listed[0][0] is mine[0][0]


class Named(NamedTuple):
    """An observation with names."""

    x: np.ndarray


SHOWN = {
    "an array": (lambda x: x, lambda seen: seen),
    "a mapping": (lambda x: {"x": x}, lambda seen: seen["x"]),
    "an ordered mapping": (lambda x: OrderedDict(x=x), lambda seen: seen["x"]),
    "a tuple": (lambda x: (x, 0), lambda seen: seen[0]),
    "a tuple with names": (lambda x: Named(x), lambda seen: seen.x),
    "a list in a mapping": (lambda x: {"x": [x]}, lambda seen: seen["x"][0]),
}
READERS = {
    "the observation": lambda env, observation, info: observation,
    "infos": lambda env, observation, info: info["x"],
}


@pytest.mark.filterwarnings("ignore:safety filter")
@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("vector", [False, True])
def test_a_policy_may_write_to_what_it_was_shown(reader, vector):
    plant = Plant(
        MODELS[0], [post(3.0)], READERS[reader], period=0.02,
        input_set=models.Box.symmetric(5.0),
    )  # fmt: skip
    if vector:
        env = wrappers.VectorSafetyFilter(gym.vector.SyncVectorEnv(2 * [moving]), plant=plant)
    else:
        env = wrappers.SafetyFilter(moving(), plant=plant)
    observation, info = env.reset(seed=0)
    u = np.array([5.0, 0.0]) if not vector else np.tile([5.0, 0.0], (2, 1))
    for _ in range(200):
        observation[..., :2] -= 5.0
        info["x"][..., :2] -= 5.0
        observation, _, _, _, info = env.step(u)
        x = np.atleast_2d(observation)
        assert (np.hypot(x[:, 0] - 3.0, x[:, 1]) >= 0.5).all()


@pytest.mark.filterwarnings("ignore:safety filter")
@pytest.mark.parametrize("kind", SHOWN)
def test_a_policy_may_write_to_it_whatever_holds_it(kind):
    show, read = SHOWN[kind]

    class Shows(World):
        def reset(self, **options):
            return show(super().reset(**options)[0]), {}

        def step(self, action):
            return show(super().step(action)[0]), 0.0, False, False, {}

    plant = Plant(
        MODELS[0], [post(3.0)], lambda env, observation, info: read(observation), period=0.02,
        input_set=models.Box.symmetric(5.0),
    )  # fmt: skip
    env = wrappers.SafetyFilter(Shows(period=0.02), plant=plant)
    observation, _ = env.reset(seed=0)
    for _ in range(200):
        read(observation)[:2] -= 5.0
        observation = env.step(np.array([5.0, 0.0]))[0]
        assert np.hypot(*(env.unwrapped.x[:2] - (3.0, 0.0))) >= 0.5


@pytest.mark.filterwarnings("ignore:safety filter")
def test_reports_of_a_batch_stay_as_they_were_and_may_be_written_to():
    scene = [post(30.0)]
    plant = Plant(
        MODELS[0], lambda *_: scene, lambda envs, *_: np.zeros((2, 4)), period=0.02,
        input_set=models.Box.symmetric(3.0), covered=Coverage.COVERED,
    )  # fmt: skip
    envs = wrappers.VectorSafetyFilter(gym.vector.SyncVectorEnv(2 * [still]), plant=plant)
    envs.reset(seed=0)
    reports = []
    for at in (30.0, 30.0, 20.0, 20.0, 10.0):
        scene[0] = post(at)
        report = envs.step(np.zeros((2, 2)))[4]["safety_filter"]
        reports.append((report, {name: np.array(value) for name, value in report.items()}))
    envs.reset(seed=0)
    for report, then in reports:
        for name, value in then.items():
            np.testing.assert_array_equal(report[name], value, name)
    before = envs.step(np.zeros((2, 2)))[4]["safety_filter"]
    answers = {name: np.array(before[name]) for name in ("covered", "covered_by", "alpha1_scale")}
    for value in before.values():
        value[...] = 7
    after = envs.step(np.zeros((2, 2)))[4]["safety_filter"]
    for name, value in answers.items():
        np.testing.assert_array_equal(after[name], value, name)


@pytest.mark.filterwarnings("ignore:safety filter")
def test_guidance_looks_at_a_list_that_was_changed_and_set_again():
    listed = [post(2.0)]
    subject = VelocityFilter("cart", listed, goal=(6.0, 0.0), guidance="geodesic")
    looked = []
    for k, new in enumerate((None, Disc("other", 1, center=(2.0, 1.5), radius=1.2))):
        if new is not None:
            listed.append(new)
            subject.barriers = listed
        subject.step((0.3, 0.0), np.zeros(3), np.zeros(3), 5.0 * k)
        looked.append(subject._input._guided_at)
    assert looked == [0.0, 5.0]
    with pytest.raises(ValueError, match="read-only"):
        subject.goal[:] = 0.0


class Grown(Disc):
    """A disc of one's own that grows in place."""

    extra = 0.0

    def planar_jet(self, q):
        h, *rest = super().planar_jet(q)
        return h - self.extra, *rest


@pytest.mark.parametrize("start", [0.0, 5000.0])
def test_ones_own_kind_of_shape_is_looked_at_as_it_is_wherever_it_lies(start):
    one = Grown("grown", 1, center=(start + 3.0, 0.0), radius=0.5)
    subject = VelocityFilter("cart", [one], period=0.05)
    pose, twist = np.array([start, 0.0, 0.0]), np.zeros(3)
    before = subject.step((0.0, 0.0), pose, twist, 0.0)[1]["h"][0]
    object.__setattr__(one, "extra", 1.0)
    assert before - subject.step((0.0, 0.0), pose, twist, 0.05)[1]["h"][0] == pytest.approx(1.0)


def test_an_action_may_be_written_to():
    def to_action(u):
        u *= 2.0
        return u

    plant = Plant(
        MODELS[0], [post(30.0)], lambda env, *_: env.x.copy(), period=0.02, to_action=to_action,
        from_action=lambda action: action, input_set=models.Box.symmetric(3.0),
    )  # fmt: skip
    env = wrappers.SafetyFilter(still(), plant=plant)
    env.reset(seed=0)
    report = env.step(np.array([1.0, 0.0]))[4]["safety_filter"]
    np.testing.assert_array_equal(report["u_safe"], report["u_nominal"])


def test_an_environments_estimate_is_not_its_world():
    env = gym.make("HCBF-Regions-v0", scenario="random").unwrapped
    env.reset(seed=0)
    before = env.rom_state.copy()
    env.estimate.x[:] += 1.0
    np.testing.assert_array_equal(env.rom_state, before)


def test_a_scan_copies_its_points():
    points = np.array([[1.0, 0.0], [1.0, 0.01]])
    scan = Scan("scan", points, (0.0, 0.0, 0.0))
    points[:] = 9.0
    assert scan.points.max() == 1.0
