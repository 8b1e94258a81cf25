"""The filter of N planar plants: they are N single ones, for arrays of any kind."""

import numpy as np
import pytest
from needs import needs

import hcbf_gym
from hcbf_gym import Estimate, programs
from hcbf_gym.barriers import BarrierSet, Disc, HalfPlane, Shapes, SpeedLimit
from hcbf_gym.errors import InvalidInputError, SafetyWarning, UnknownNameError
from hcbf_gym.models import Box, Reason
from hcbf_gym.programs import FilterStatus
from tests.worlds import OwnDisc

PERIOD, U = 0.02, Box.symmetric(5.0)


def drawn(seed, count):
    """States (N, 4) and the numbers (N, 4, 3) of a scene of each, see `arrays`."""
    rng = np.random.default_rng(seed)
    x = np.concatenate([rng.uniform(-4, 4, (count, 2)), rng.uniform(-1, 1, (count, 2))], axis=1)
    numbers = np.zeros((count, 4, 3))
    numbers[:, :2, :2] = x[:, None, :2] + rng.uniform(-3, 3, (count, 2, 2))
    numbers[:, :2, 2] = rng.uniform(0.2, 0.8, (count, 2))
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    numbers[:, 2, 0], numbers[:, 2, 1] = np.cos(angle), np.sin(angle)
    numbers[:, 2, 2] = -rng.uniform(0.0, 5.0, count)
    numbers[:, 3, 0] = rng.uniform(1.5, 2.5)
    return x, numbers


def listed(numbers):
    """The scenes of `drawn` as lists of barriers."""
    return [
        [
            Disc("a", 1, center=tuple(one[0, :2]), radius=one[0, 2]),
            Disc("b", 2, center=tuple(one[1, :2]), radius=one[1, 2]),
            HalfPlane("wall", 3, normal=tuple(one[2, :2]), offset=one[2, 2]),
            SpeedLimit("cap", 1, one[3, 0]),
        ]
        for one in numbers
    ]


def arrays(numbers):
    """The scenes of `drawn` as one sequence for all, with arrays of each plant."""
    return [
        Shapes("a", 1, "disc", numbers[:, :1]),
        Shapes("b", 2, "disc", numbers[:, 1:2]),
        Shapes("wall", 3, "half-plane", numbers[:, 2:3]),
        SpeedLimit("cap", 1, numbers[0, 3, 0]),
    ]


def moved(x, u):
    after = x.copy()
    after[:, :2] += PERIOD * x[:, 2:] + 0.5 * PERIOD**2 * u
    after[:, 2:] += PERIOD * u
    return after


def same(report, other):
    assert report.keys() == other.keys()
    for key, value in report.items():
        np.testing.assert_array_equal(value, other[key], err_msg=key)


@pytest.mark.parametrize(
    "program", ["lex-cbf-qp", "r-cbf-qp", "h-cbf-qp", "ih-cbf-qp", "eh-cbf-qp"]
)
@pytest.mark.parametrize("threads", [1, 2])
def test_a_batch_is_as_many_single_filters(program, threads):
    count = 150
    x, numbers = drawn(0, count)
    scenes = listed(numbers)
    rng = np.random.default_rng(1)
    weights, own = {}, [{}] * count
    if "gamma0" in programs.options(program):
        gamma0, delta = 10.0 ** rng.uniform(-1.0, 2.0, (count, 2)), rng.uniform(0.0, 2.0, count)
        weights = {"gamma0": gamma0, "delta_gamma": delta[:, None]}
        own = [{"gamma0": gamma0[i], "delta_gamma": delta[i]} for i in range(count)]
    batch = hcbf_gym.BatchFilter(U, PERIOD, count, program, threads=threads, **weights)
    batch.set_scene(arrays(numbers))
    singles = [hcbf_gym.BatchFilter(U, PERIOD, None, program, **one) for one in own]
    begun = batch.reset(x=x)
    for i, one in enumerate(singles):
        one.set_scene(scenes[i])
        same(one.reset(x=x[i]), {key: value[i] for key, value in begun.items()})
    statuses = set()
    for _ in range(12):
        wanted = rng.uniform(-6.0, 6.0, (count, 2))
        u, report = batch(wanted, x)
        statuses |= set(report["status"].tolist())
        for i, one in enumerate(singles):
            own, answers = one(wanted[i], x[i])
            np.testing.assert_array_equal(own, u[i])
            same(answers, {key: value[i] for key, value in report.items()})
        x = moved(x, u)
    assert len(statuses) >= 3  # neither all idle nor all in conflict


def test_one_list_is_for_all_and_short_lists_are_filled():
    near = Disc("near", 1, center=(0.8, 0.0), radius=0.5)
    far = HalfPlane("far", 2, normal=(0.0, 1.0), offset=-9.0)
    x = np.zeros((3, 4))
    for_all = hcbf_gym.BatchFilter(U, PERIOD, 3)
    for_all.set_scene([near])
    ragged = hcbf_gym.BatchFilter(U, PERIOD, 3)
    ragged.set_scene([[near], [near, far], []])
    for filt in (for_all, ragged):
        filt.reset(x=x)
    wanted = np.tile([5.0, 0.0], (3, 1))
    (u, _), (other, report) = for_all(wanted, x), ragged(wanted, x)
    assert (u[0] == u).all()
    np.testing.assert_array_equal(u[:2], other[:2])
    np.testing.assert_array_equal(other[2], wanted[2])  # an empty scene forbids nothing
    assert report["status"][2] == FilterStatus.NOMINAL
    assert ragged.conditions(2)[0].name == "nothing"


PARTS = {
    "x": np.zeros((3, 4)),
    "time": np.full(3, PERIOD),
    "covariance": np.zeros((3, 4, 4)),
    "model": np.zeros((3, 4)),
    "lag": np.zeros((3, 4)),
    "age": np.zeros(3),
    "fault": np.zeros(3),
    "elapsed": np.full(3, PERIOD),
}


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", PARTS)
@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")
def test_a_nan_of_one_plant_brakes_it_alone_whatever_the_type(name, bad, dtype):
    filt = hcbf_gym.BatchFilter(U, PERIOD, 3)
    filt.set_scene([Disc("far", 1, center=(50.0, 0.0), radius=1.0)])
    filt.reset(x=np.zeros((3, 4)))
    part = PARTS[name].astype(dtype)
    part[1] = bad
    reported = Estimate(np.zeros((3, 4)))._replace(**{name: part})
    _, report = filt(np.ones((3, 2)), reported)
    assert (report["status"] == FilterStatus.BACKUP).tolist() == [False, True, False]


def test_a_missing_sample_brakes_and_a_varying_period_is_no_alarm():
    filt = hcbf_gym.BatchFilter(U, PERIOD, 2)
    filt.set_scene([Disc("far", 1, center=(50.0, 0.0), radius=1.0)])
    x, time = np.zeros((2, 4)), 0.0
    filt.reset(x=x)
    rng = np.random.default_rng(0)
    u, _ = filt(np.ones((2, 2)), x, time)
    for _ in range(60):
        elapsed = rng.uniform(0.2, 1.0) * PERIOD
        x, time = x.copy(), time + elapsed
        x[:, :2] += elapsed * x[:, 2:] + 0.5 * elapsed**2 * u
        x[:, 2:] += elapsed * u
        u, report = filt(rng.uniform(-1.0, 1.0, (2, 2)), x, time, elapsed=elapsed)
        assert (report["reason"] == Reason.NONE).all()
    with pytest.warns(SafetyWarning, match="older"):
        u, report = filt(np.ones((2, 2)), x, time + PERIOD, missing=[False, True])
    assert report["reason"].tolist() == [Reason.NONE, Reason.AGE]
    with pytest.warns(SafetyWarning, match="not finite"):
        _, report = filt(np.ones((2, 2)), x, time + 2.0 * PERIOD, elapsed=-1.0)
    assert (report["reason"] == Reason.STATE).all()


def test_what_a_mask_hides_is_no_number_and_brakes_alone():
    filt = hcbf_gym.BatchFilter(U, PERIOD, 3)
    filt.set_scene([DISC])
    filt.reset(x=np.zeros((3, 4)))
    hidden = np.ma.masked_array(np.zeros((3, 4)), np.arange(12).reshape(3, 4) == 5)
    with pytest.warns(SafetyWarning, match="not finite"):
        _, report = filt(np.ones((3, 2)), hidden)
    assert report["reason"].tolist() == [Reason.NONE, Reason.STATE, Reason.NONE]


def test_a_sample_that_is_old_stays_old_where_another_is_missing():
    filt = hcbf_gym.BatchFilter(U, PERIOD, 3)
    filt.set_scene([DISC])
    filt.reset(x=np.zeros((3, 4)))
    old = Estimate(np.zeros((3, 4)), age=np.array([0.0, np.inf, 0.0]))
    with pytest.warns(SafetyWarning, match="older"):
        _, report = filt(np.ones((3, 2)), old, missing=[False, False, True])
    assert report["reason"].tolist() == [Reason.NONE, Reason.AGE, Reason.AGE]
    for bad in ([0, 1, 0], [True, False], "all"):
        with pytest.raises(InvalidInputError, match="missing"):
            filt(np.ones((3, 2)), old, missing=bad)


def test_a_reset_that_fails_leaves_no_episode():
    filt = hcbf_gym.BatchFilter(U, PERIOD, 2, guidance="geodesic")
    filt.set_scene([DISC])
    x = np.zeros((2, 4))
    filt.reset(x=x, goal=(3.0, 0.0))
    filt.set_scene([OwnDisc("own", 2)])
    with pytest.raises(InvalidInputError, match="own kind"):
        filt.reset([False, True], x)
    filt.set_scene([DISC])
    with pytest.raises(InvalidInputError, match="1 of 2"):
        filt(np.ones((2, 2)), x)
    for bad in ("there", [1.0], np.full(2, np.nan), np.zeros((3, 2))):
        with pytest.raises(InvalidInputError, match="goal"):
            filt.reset(x=x, goal=bad)


def test_some_begin_anew_while_the_others_go_on():
    x, numbers = drawn(4, 6)
    one, other = (hcbf_gym.BatchFilter(U, PERIOD, 6) for _ in range(2))
    for filt in (one, other):
        filt.set_scene(arrays(numbers))
        filt.reset(x=x)
    wanted = np.full((6, 2), 2.0)
    for _ in range(5):
        u, _ = one(wanted, x)
        other(wanted, x)
        x = moved(x, u)
    mask = np.arange(6) == 2
    x[2] = 0.0, 0.0, 0.0, 0.0
    one.reset(mask, x)
    other.reset(x=x)
    u, report = one(wanted, x)
    _, begun = other(wanted, x)
    assert (report["reason"] == Reason.NONE).all()
    same({k: v[2] for k, v in report.items()}, {k: v[2] for k, v in begun.items()})


def test_a_refused_scene_stops_all_until_a_good_one_is_set():
    filt = hcbf_gym.BatchFilter(U, PERIOD, 2)
    good = [Disc("far", 1, center=(9.0, 0.0), radius=1.0)]
    filt.set_scene(good)
    x = np.zeros((2, 4))
    filt.reset(x=x)
    with pytest.raises(InvalidInputError, match="speed limit"):
        filt.set_scene([SpeedLimit("cap", 1, 1e-3)])
    with pytest.warns(SafetyWarning, match="barriers"):
        _, report = filt(np.ones((2, 2)), x)
    assert (report["reason"] == Reason.BARRIERS).all()
    filt.set_scene(good)
    _, report = filt(np.ones((2, 2)), x)
    assert (report["reason"] == Reason.NONE).all()


DISC = Disc("disc", 1, (1.0, 0.0), 0.5)


def discs(values, velocity=(0.0, 0.0)):
    return Shapes("a", 1, "disc", values, velocity)


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (lambda: "disc", "sequence"),
        (lambda: 7, "sequence"),
        (lambda: [[], [], []], "2 lists"),
        (lambda: [[1], [2]], "expected an object of a class derived"),
        (lambda: BarrierSet([[DISC]] * 2), "the sequence of barriers"),
        (lambda: [discs([[[1.0, 0.0, 0.5]]] * 3)], "got values of 3 plants, expected 2"),
        (lambda: [Shapes("a", 1, "disk", [[1.0, 0.0, 0.5]])], "'disc'"),
        (lambda: [discs([[1.0, 0.0, -0.5]])], "radius"),
        (lambda: [discs([[1.0, 0.0]])], "shape"),
        (lambda: [discs([1.0, 0.0, 0.5])], "shape"),
        (lambda: [Shapes("a", 0, "disc", [[1.0, 0.0, 0.5]])], "priority"),
        (lambda: [discs([[1.0, 0.0, 0.5]], [[np.inf, 0.0]])], "velocity"),
        (lambda: [discs([[1.0, 0.0, 0.5]], [[1.0, 0.0]] * 2)], "velocity"),
        (lambda: [discs([[0.0, np.nan, 1.0]])], "finite"),
        (lambda: [discs("discs")], "numbers"),
        (lambda: [Shapes("a", 1, "half-plane", [[1.0, 1.0, 0.0]])], "expected 1"),
        (lambda: [Shapes("a", 1, "convex-polygon", [[[0, 0], [0, 1], [1, 0]]])], "counter"),
        (lambda: [SpeedLimit("cap", 1, 0.01)], "speed limit"),
    ],
)
def test_a_bad_scene_is_refused_in_words(scene, message):
    filt = hcbf_gym.BatchFilter(U, PERIOD, 2)
    with pytest.raises((InvalidInputError, UnknownNameError), match=message) as refused:
        filt.set_scene(scene())
    assert len(str(refused.value)) < 1000


def test_bad_arguments_are_refused_in_words():
    for options, message in (
        ({"num_envs": 0}, "num_envs"),
        ({"threads": 0}, "threads"),
        ({"period": -1.0}, "period"),
        ({"program": "lex"}, "lex-cbf-qp"),
        ({"guidance": "star"}, "geodesic"),
        ({"gain": 1.0}, "gain"),
        ({"on_alarm": "shout"}, "warn"),
    ):
        with pytest.raises(InvalidInputError, match=message):
            hcbf_gym.BatchFilter(**({"input_set": U, "period": PERIOD, "num_envs": 2} | options))
    with pytest.raises(InvalidInputError, match="two inputs"):
        hcbf_gym.BatchFilter(Box.symmetric(1.0, 3), PERIOD, 2)
    filt = hcbf_gym.BatchFilter(U, PERIOD, 5000)
    x = np.zeros((5000, 4))
    with pytest.raises(InvalidInputError, match="set_scene"):
        filt.reset(x=x)
    filt.set_scene([DISC])
    with pytest.raises(InvalidInputError, match="no x"):
        filt.reset()
    with pytest.raises(InvalidInputError, match="mask"):
        filt.reset([1, 2], x)
    with pytest.raises(InvalidInputError, match="5000 of 5000"):
        filt(np.zeros((5000, 2)), x)
    filt.reset(x=x)
    with pytest.raises(InvalidInputError, match="u_nominal"):
        filt(np.zeros((2, 5000)), x)
    wanted = np.zeros((5000, 2))
    wanted[4711] = np.nan
    with pytest.raises(InvalidInputError, match="4711") as refused:
        filt(wanted, x)
    assert len(str(refused.value)) < 300


@needs("torch")
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_torch_goes_in_without_a_copy_and_comes_out(dtype):

    import torch

    x, numbers = drawn(5, 30)
    kind = getattr(torch, dtype)
    filt, other = (hcbf_gym.BatchFilter(U, PERIOD, 30) for _ in range(2))
    for each in (filt, other):
        each.set_scene(arrays(numbers))
    states, wanted = torch.tensor(x, dtype=kind), torch.full((30, 2), 3.0, dtype=kind)
    filt.reset(x=states)
    other.reset(x=states.numpy())
    u, report = filt(wanted, states)
    theirs, _ = other(wanted.numpy(), states.numpy())
    assert isinstance(u, torch.Tensor)
    assert isinstance(report["h"], torch.Tensor)
    assert u.dtype == kind
    np.testing.assert_array_equal(u.numpy(), theirs)
    with pytest.raises(InvalidInputError, match="detach"):
        filt(wanted.requires_grad_(), states)


@needs("jax")
def test_jax_goes_in_and_comes_out():

    import jax

    x, numbers = drawn(5, 30)
    filt = hcbf_gym.BatchFilter(U, PERIOD, 30)
    filt.set_scene(arrays(numbers))
    states = jax.numpy.asarray(x)
    filt.reset(x=states)
    u, report = filt(jax.numpy.full((30, 2), 3.0), states)
    assert isinstance(u, jax.Array)
    assert isinstance(report["status"], jax.Array)
    with pytest.raises(InvalidInputError, match="pure_callback"):
        jax.jit(lambda wanted: filt(wanted, states)[0])(jax.numpy.ones((30, 2)))
