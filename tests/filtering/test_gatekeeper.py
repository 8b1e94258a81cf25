"""Strict conditions that verified manoeuvres satisfy, against a NumPy text of the same law."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from needs import needs
from readable_gate import input_of, moved, path, reserves

import hcbf_gym
from benchmarks import gatekeeper as attack
from hcbf_gym import _core
from hcbf_gym._core import Reason
from hcbf_gym.barriers import (
    Capsule,
    ConvexPolygon,
    Disc,
    Ellipse,
    Function,
    HalfPlane,
    Shapes,
    SpeedLimit,
    layout,
)
from hcbf_gym.errors import InvalidInputError, SafetyWarning, UnknownNameError
from hcbf_gym.filter import gatekeeper
from hcbf_gym.models.input_sets import Ball, Box
from hcbf_gym.models.plant import Estimate, Uncertainty
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter
from tests.worlds import with_others

T = 0.02
BOX = Box.symmetric(5.0)
SETS = [BOX, Box((-2.0, -4.0), (3.0, 1.0)), Ball(4.0, 16), Ball(3.0, 3), Ball(3.0, 5)]
REGIONS = with_others(
    HalfPlane("wall", 1, (0.6, 0.8), -0.3),
    Disc("disc", 1, (0.3, -0.2), 0.4),
    Ellipse("ellipse", 1, (0.2, 0.1), (0.7, 0.2), 0.5),
    Capsule("capsule", 1, (-0.4, 0.0), (0.5, 0.3), 0.2),
    ConvexPolygon("polygon", 1, ((-0.5, -0.3), (0.4, -0.4), (0.6, 0.2), (-0.1, 0.5))),
)


def block(shape):
    """Return the numbers of a shape."""
    numbers = np.zeros(layout.WIDTH)
    shape.write(numbers)
    return numbers


def filtered(scene, x=(0.0, 0.0, 0.0, 0.0), input_set=BOX, period=T, **others):
    """Return a filter of one plant after its reset."""
    found = hcbf_gym.BatchFilter(input_set, period, strict="gatekeeper", **others)
    found.set_scene(scene)
    found.reset(x=np.array(x))
    return found


def driven(found, u_nominal, x, steps, period=T):
    """Return states and reports of a plant that is its model."""
    x, states, reports = np.array(x, dtype=np.float64), [], []
    for k in range(steps):
        u, report = found(np.array(u_nominal, dtype=np.float64), x, k * period)
        states.append(x)
        reports.append(report)
        x = moved(x, u, period)
    return np.array(states), reports


@pytest.mark.parametrize("input_set", SETS, ids=str)
def test_pieces_of_a_manoeuvre_are_its_samples(input_set):
    rng = np.random.default_rng(0)
    for _ in range(100):
        period = rng.choice([0.01, 0.02, 0.1])
        x, target = rng.normal(size=4) * 2.0, rng.normal(size=2)
        samples = int(rng.integers(0, 40))
        states, inputs = path(input_set, period, x, target, samples)
        pieces = _core.manoeuvre(input_set.vertices(), period, tuple(target), samples, x)
        at = np.rint(np.concatenate([[0.0], np.cumsum(pieces[:, 6])]) / period).astype(int)[:-1]
        most = np.minimum(at, len(states) - 1)  # a rest that the other reaches but for rounding
        np.testing.assert_allclose(pieces[:, :4], states[most], atol=1e-7)
        assert np.all(pieces[-1, 2:4] == 0.0)
        for piece, first, end in zip(pieces, at, at[1:], strict=False):
            assert np.abs(inputs[first:end] - piece[4:6]).max(initial=0.0) < 1e-6


@pytest.mark.parametrize("input_set", SETS, ids=str)
def test_two_paths_of_a_manoeuvre_get_no_farther_apart_in_velocity(input_set):
    rng = np.random.default_rng(1)
    for _ in range(100):
        period = rng.choice([0.01, 0.05])
        x, target = rng.normal(size=4), rng.normal(size=2)
        other = x + rng.normal(size=4) * 10.0 ** rng.uniform(-3, 0)
        apart = np.linalg.norm((other - x)[2:])
        place = np.linalg.norm((other - x)[:2])
        for k in range(60):
            samples = 20 - k
            x = moved(x, input_of(input_set, period, x, target, samples), period)
            other = moved(other, input_of(input_set, period, other, target, samples), period)
            assert np.linalg.norm((other - x)[2:]) <= apart + 1e-12
            assert np.linalg.norm((other - x)[:2]) <= place + apart * period * (k + 1) + 1e-12


@pytest.mark.parametrize("shape", REGIONS, ids=lambda one: one.name)
def test_between_samples_a_path_passes_if_it_is_clear(shape):
    rng, seen = np.random.default_rng(2), 0
    for _ in range(400):
        span = rng.choice([0.02, 0.1, 0.5])
        p, r, u = rng.uniform(-2, 2, 2), rng.normal(size=2) * 2.0, rng.normal(size=2) * 5.0
        grows = rng.choice([0.0, 0.2])
        tau = np.linspace(0.0, span, 800)[:, None]
        h = np.array([shape.planar_jet(q)[0] for q in p + (r + 0.5 * u * tau) * tau])
        least = (h - grows * tau[:, 0]).min()
        if least < 2e-5:
            continue
        seen += 1
        for spare, expected in ((2e-5, True), (-1e-9, False)):
            path = [*p, *r, *u, span, least - spare, grows]
            assert _core.clears(shape.code, block(shape), path) == expected
    assert seen > 100


@pytest.mark.parametrize("input_set", SETS, ids=str)
def test_what_follows_an_accepted_input_is_clear_until_rest_and_after_it(input_set):
    rng = np.random.default_rng(3)
    for _ in range(15):
        scene = [
            one.moved(rng.uniform(1.2, 2.0) * np.array([np.cos(a), np.sin(a)]))
            for one, a in zip(REGIONS, rng.uniform(0, 6.28, len(REGIONS)), strict=True)
        ]
        scene[1] = Disc("moves", 1, (2.0, 1.5), 0.3, velocity=rng.normal(size=2))
        scene = [one for one in scene if one.jet(np.zeros(4)).h > 0.3] + [SpeedLimit("v", 1, 1.5)]
        x = np.concatenate([np.zeros(2), rng.uniform(-0.5, 0.5, 2)])
        found = filtered(scene, x, input_set)
        u, report = found(rng.normal(size=2) * 9.0, x, 0.0)
        if report["verified"] == 0:
            continue
        law = found._core.samples.plants["verified"]["law"][0]
        states, inputs = path(input_set, T, moved(x, u, T), law["target"], int(law["samples"]))
        least = reserves(scene, T, np.vstack([x, states]), np.vstack([u, inputs]), 0.0, 0.0)
        assert least >= -1e-9


def test_a_robot_stops_at_the_margin_and_no_sooner_than_it_has_to():
    wall = [HalfPlane("wall", 1, (-1.0, 0.0), -2.0)]
    states, reports = driven(filtered(wall), (5.0, 0.0), np.zeros(4), 200)
    assert all(report["verified"] == 1 for report in reports)
    h = 2.0 - states[:, 0]
    assert 0.0 <= h.min() < 1e-3  # 50 periods of the optimum
    optimum = 2.0 * np.sqrt(2.0 / 5.0)
    assert np.argmax(h < 0.01) * T < optimum + 0.1


@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")
def test_a_verified_speed_leaves_what_a_limit_reserves():
    rng, weak = np.random.default_rng(9), Box.symmetric(0.3)
    limit, seen = [SpeedLimit("v", 1, 1.0)], 0
    for _ in range(200):
        x = np.concatenate([np.zeros(2), rng.uniform(0.9, 1.0) * np.array([0.6, 0.8])])
        found = filtered(limit, x, weak, uncertainty=Uncertainty(speed=0.05))
        u, report = found(rng.normal(size=2), x, 0.0)
        if report["verified"]:
            seen += 1
            assert np.linalg.norm(x[2:] + T * u) <= np.sqrt(1.0 - 2.0 * 0.05) + 1e-9
    assert 20 < seen < 180


def test_margins_grow_by_no_more_than_is_reserved():
    found = filtered([SpeedLimit("v", 1, 2.0), Disc("disc", 1, (3.0, 0.0), 0.5)])
    reserve, x = found._core.samples.plants["verified"]["reserve"], np.zeros(4)
    before, grows = reserve[0].copy(), np.hstack([0.5 * T**2 * np.eye(2), T * np.eye(2)])
    moves, covariance = np.eye(4) + T * np.eye(4, k=2), 1e-6 * np.eye(4)
    for k in range(20):
        found(np.zeros(2), Estimate(x, k * T, covariance))
        now = reserve[0].copy()
        if k > 1:  # the growth is measured
            assert now["speed"] <= before["speed"] + before["faster"] + 1e-12
            assert now["keep"] <= before["keep"] + before["ahead"]
        before, covariance = now, moves @ covariance @ moves.T + 0.1 * grows.T @ grows


def test_an_input_that_a_manoeuvre_can_follow_is_not_changed():
    rng, scene = np.random.default_rng(4), [Disc("disc", 1, (1.5, 0.0), 0.5)]
    for _ in range(50):
        x = np.concatenate([rng.uniform(-0.5, 0.3, 2), rng.uniform(-1.0, 1.0, 2)])
        u = rng.uniform(-5.0, 5.0, 2)
        _, report = filtered(scene, x)(u, x, 0.0)
        states, inputs = path(BOX, T, moved(x, u, T), np.zeros(2), 0)
        if reserves(scene, T, states, inputs, T, 1e-4, sweep=0.1) > 0.0:
            assert report["status"] == FilterStatus.NOMINAL


@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")  # of the monitor, by errors
def test_what_is_accepted_passes_at_the_next_sample_whatever_the_errors():
    rng, refuted = np.random.default_rng(5), 0
    for _ in range(6):
        case = attack.draw(rng)._replace(position=0.02, velocity=0.05)
        found = case.filter(50)
        found.set_scene([Disc("disc", 1, (1.5, 0.2), 0.5), HalfPlane("wall", 1, (0, 1), -1.0)])
        x, t = np.zeros((50, 4)), np.zeros(50)
        found.reset(x=case.estimate(x, t, x))
        for _ in range(60):
            seen = found._scenes.sense(x, t)[1]
            error = attack.errors(rng, seen)
            u, report = found(rng.normal(size=(50, 2)) * 6.0, case.estimate(x, t, error), t)
            refuted += int((report["verified"] == 0).sum())
            x = np.array([moved(one, to, case.period) for one, to in zip(x, u, strict=True)])
            t = t + case.period
    assert refuted == 0


@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")  # of the monitor, by errors
def test_no_region_is_entered_under_attack():
    rng = np.random.default_rng(6)
    happened = sum((attack.episode(rng, 50, 60)[0] for _ in range(8)), start=attack.Counter())
    assert happened["calm"] > 0.95 * happened["steps"]
    assert happened["entered while calm"] == happened["rank 2 entered while verified"] == 0


@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")  # of the monitor, by errors
@pytest.mark.parametrize("errs", [False, True])
def test_a_batch_is_its_plants_bit_for_bit(errs):
    rng = np.random.default_rng(7)
    case = attack.draw(rng)._replace(position=0.01 * errs, velocity=0.02 * errs, covaries=errs)
    scenes = [attack.scene(rng) for _ in range(70)]
    many = case.filter(70, threads=2)
    many.set_scene(scenes)
    x, t = np.zeros((70, 4)), np.zeros(70)
    many.reset(x=case.estimate(x, t, x))
    each = [hcbf_gym.BatchFilter(case.input_set, case.period, strict="gatekeeper",
            uncertainty=many._core.plant.uncertainty) for _ in scenes]  # fmt: skip
    for one, own in zip(each, scenes, strict=True):
        one.set_scene(own)
        one.reset(x=case.estimate(x[:1], t[:1], x[:1]))
    for _ in range(20):
        u, error = rng.normal(size=(70, 2)) * 5.0, rng.normal(size=(70, 4)) * 0.5
        chosen, report = many(u, case.estimate(x, t, error), t)
        for i, one in enumerate(each):
            part = slice(i, i + 1)
            own, single = one(u[i], case.estimate(x[part], t[part], error[part]), t[i])
            assert own.tobytes() == chosen[i].tobytes()
            assert single["verified"] == report["verified"][i]
        x = np.array([moved(one, to, case.period) for one, to in zip(x, chosen, strict=True)])
        t = t + case.period


def test_lower_ranks_give_up_first_and_that_is_reported():
    scene = [Disc("strict", 1, (2.0, 0.0), 0.5), HalfPlane("soft", 2, (1.0, 0.0), 0.5)]
    x = np.array([0.5, 0.0, -1.5, 0.0])  # which no input keeps out of the rank 2
    _, report = filtered(scene, x)(np.zeros(2), x, 0.0)
    assert (report["verified"], report["status"]) == (1, FilterStatus.RELAXED)
    x = np.array([1.0, 0.0, 0.0, 0.0])
    _, report = filtered(scene, x)(np.zeros(2), x, 0.0)
    assert (report["verified"], report["status"]) == (2, FilterStatus.NOMINAL)


def test_without_a_manoeuvre_the_rows_decide_until_one_is_found():
    scene = [HalfPlane("wall", 1, (-1.0, 0.0), -1.0)]
    found, rows = filtered(scene), hcbf_gym.BatchFilter(BOX, T)
    rows.set_scene(scene)
    x = np.zeros(4)
    rows.reset(x=x)
    found(np.zeros(2), x, 0.0)
    x = np.array([0.8, 0.0, 2.0, 0.0])  # a push: half a metre too fast
    rows(np.zeros(2), np.zeros(4), 0.0)
    with pytest.warns(SafetyWarning, match="no manoeuvre"):
        u, report = found(np.zeros(2), x, T)
    by_rows, expected = rows(np.zeros(2), x, T)
    assert report["reason"] == Reason.UNVERIFIED
    assert report["verified"] == 0
    assert report["status"] == expected["status"] == FilterStatus.VIOLATED
    assert u.tobytes() == by_rows.tobytes()
    _, report = found(np.zeros(2), np.array([0.5, 0.0, 0.0, 0.0]), 2 * T)
    assert (report["reason"], report["verified"]) == (Reason.NONE, 1)


@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")  # of the state
def test_after_a_fault_the_last_manoeuvre_goes_on_for_at_most_max_age():
    lane = Disc("lane", 1, (1.0, -3.0), 0.5, velocity=(0.0, 2.0))
    for max_age, steps in ((None, 40), (0.1, 5)):
        filt = hcbf_gym.BatchFilter(BOX, T, strict="gatekeeper")
        if max_age is not None:
            filt._core.config.constants["longest"] = max_age
        filt.set_scene([lane, SpeedLimit("v", 1, 1.5)])
        x = np.array([0.0, 0.0, 1.2, 0.0])
        filt.reset(x=x)
        u, _ = filt(np.array([5.0, 0.0]), x, 0.0)
        assert filt._core.samples.plants["verified"]["rank"][0] == 1
        gone = 0
        for k in range(1, 41):
            x = moved(x, u, T)
            law = filt._core.samples.plants["verified"][0].copy()
            u, report = filt(np.zeros(2), np.full(4, np.nan), k * T)
            assert report["status"] == FilterStatus.BACKUP
            assert report["reason"] == Reason.STATE
            expected = input_of(BOX, T, x, law["law"]["target"], int(law["law"]["samples"]))
            if filt._core.samples.plants["verified"]["rank"][0]:
                gone += 1
                np.testing.assert_allclose(u, expected, atol=1e-6)
            else:
                np.testing.assert_allclose(u, BOX.project(-x[2:] / T), atol=1e-6)
        assert gone == steps


@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")
def test_without_a_state_regions_move_for_as_long_as_the_plant():
    found = filtered([Disc("disc", 1, (2.0, 0.0), 0.5, velocity=(0.0, 0.1))])
    found(np.array([5.0, 0.0]), np.zeros(4), 0.0)
    for k in range(1, 5):
        found(np.zeros(2), np.full(4, np.nan), 0.005 * k, elapsed=0.005)
        memory = found._core.samples.plants["verified"][0]
        assert memory["rank"] == 1
        assert memory["lost"] == pytest.approx(0.005 * k)


def test_a_reset_forgets_the_manoeuvre_of_that_plant_alone():
    filt = hcbf_gym.BatchFilter(BOX, T, 2, strict="gatekeeper")
    filt.set_scene([Disc("disc", 1, (2.0, 0.0), 0.5)])
    x = np.zeros((2, 4))
    filt.reset(x=x)
    filt(np.ones((2, 2)), x)
    filt.reset(np.array([True, False]), x)
    assert filt._core.samples.plants["verified"]["rank"].tolist() == [0, 1]


def test_holds_that_are_shorter_are_verified_again():
    rng = np.random.default_rng(8)
    scene = [Disc("disc", 1, (1.0, 0.1), 0.4), HalfPlane("wall", 1, (0.0, 1.0), -0.5)]
    found, x, t, least = filtered(scene, period=0.1), np.zeros(4), 0.0, np.inf
    span = 0.1
    for _ in range(300):
        u, report = found(rng.normal(size=2) * 9.0 + (3.0, -2.0), x, t, elapsed=span)
        assert report["status"] <= FilterStatus.SAFE
        span = float(rng.uniform(0.01, 0.1))
        for tau in np.linspace(0.0, span, 20):
            least = min(least, *(one.jet(moved(x, u, tau)).h for one in scene))
        x, t = moved(x, u, span), t + span
    assert least >= -1e-9


def test_the_end_of_a_path_lets_the_robot_rest_beyond_it():
    places = [[3.0, -4.0, 0.4]]
    x = np.array([3.0, 3.0, 0.0, 0.0])  # on its line
    for lasts, verified in ((np.inf, True), (4.0, True), (1.0, True)):
        coming = Shapes("coming", 1, "disc", places, velocity=(0.0, 1.0), moves_for=lasts)
        _, report = filtered([coming], x)(np.zeros(2), x, 0.0)
        law = report["verified"] == 1
        assert law == verified
    laws = {}
    for lasts in (np.inf, 4.0):
        coming = Shapes("coming", 1, "disc", places, velocity=(0.0, 1.0), moves_for=lasts)
        found = filtered([coming], x)
        found(np.zeros(2), x, 0.0)
        laws[lasts] = int(found._core.samples.plants["verified"]["law"]["samples"][0])
    assert laws[4.0] == 0  # it brakes where it is
    assert laws[np.inf] > 0  # it has to step aside


@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")
def test_where_a_path_has_ended_rows_are_not_calm():
    places, x = [[-1.0, 0.0, 0.4]], np.zeros(4)
    found = filtered([Shapes("ram", 1, "disc", places, velocity=(5.0, 0.0), moves_for=0.2)], x)
    for k in range(60):
        u, report = found(np.zeros(2), x, k * T)
        inside = np.hypot(x[0] + 1.0 - 5.0 * min(k * T, 0.2), x[1]) < 0.4
        assert report["status"] > FilterStatus.RELAXED or not inside
        x = moved(x, u, T)


@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")
def test_a_manoeuvre_that_fails_at_any_call_gives_no_input(request):
    calls = {"left": 0}

    def fails(x, begun):
        calls["left"] -= begun == 0
        target = np.array([0.0, 1.0]) if begun < 45 else np.zeros(2)
        return (target - x[2:]) / T if calls["left"] else np.full(2, np.nan)

    gatekeeper.register(request.node.name, fails)
    gate = {"kind": "gatekeeper", "directions": 1, "manoeuvres": [request.node.name]}
    known = Uncertainty(distance=0.3, speed=0.02)
    found = hcbf_gym.BatchFilter(BOX, T, strict=gate, uncertainty=known)
    found.set_scene([Disc("coming", 1, (-2.6, 0.0), 0.4, velocity=(2.0, 0.0))])
    for call in range(1, 30):
        calls["left"] = 0
        found.reset(x=np.zeros(4))
        calls["left"] = call
        assert np.isfinite(found(np.array([-5.0, 0.0]), np.zeros(4), 0.0)[0]).all()
    del gatekeeper._OWN[request.node.name]


@pytest.mark.filterwarnings("error::hcbf_gym.errors.SafetyWarning")
@pytest.mark.parametrize(("count", "threads"), [(1, 1), (200, 2)])
def test_what_a_manoeuvre_raises_reaches_its_user(request, count, threads):
    gatekeeper.register(request.node.name, lambda x, begun: 1 / 0)
    gate = {"kind": "gatekeeper", "manoeuvres": [request.node.name]}
    found = hcbf_gym.BatchFilter(BOX, T, count, threads=threads, strict=gate)
    found.set_scene([Disc("coming", 1, (-1.0, 0.0), 0.4, velocity=(2.0, 0.0))])
    with pytest.raises(SafetyWarning, match="ZeroDivisionError"):
        found.reset(x=np.zeros((count, 4)))
    del gatekeeper._OWN[request.node.name]


def test_a_manoeuvre_of_the_users_is_followed(request):
    name = request.node.name
    calls = []

    def sidestep(x, begun):
        calls.append(begun)
        target = np.array([0.0, 1.0]) if begun < 45 else np.zeros(2)
        return (target - x[2:]) / T

    gatekeeper.register(name, sidestep)
    coming = Disc("coming", 1, (-6.0, 0.0), 0.4, velocity=(2.0, 0.0))
    gate = {"kind": "gatekeeper", "directions": 1, "manoeuvres": [name]}
    found = hcbf_gym.BatchFilter(BOX, T, strict=gate)
    found.set_scene([coming])
    x = np.zeros(4)
    found.reset(x=x)
    assert found(np.zeros(2), x, 0.0)[1]["verified"] == 1
    assert found._core.samples.plants["verified"]["law"]["own"][0] == 1
    assert max(calls) > 40
    with pytest.raises(InvalidInputError, match="name not in"):
        gatekeeper.register(name, sidestep)
    gatekeeper._OWN[name] = lambda x, begun: 1 / 0
    warned = pytest.warns(SafetyWarning, match="ZeroDivisionError")
    with warned, pytest.warns(SafetyWarning, match="no manoeuvre"):
        _, report = found(np.zeros(2), x, 1.0)
    del gatekeeper._OWN[name]
    assert report["reason"] == Reason.UNVERIFIED


def test_copies_and_pickles_go_on_alike():
    found = filtered([Disc("disc", 1, (1.0, 0.1), 0.4)])
    x = np.array([0.0, 0.0, 1.0, 0.0])
    found(np.array([5.0, 0.0]), x, 0.0)
    others = copy.deepcopy(found), pickle.loads(pickle.dumps(found))
    expected, _ = found(np.array([5.0, 1.0]), x, T)
    for other in others:
        assert other(np.array([5.0, 1.0]), x, T)[0].tobytes() == expected.tobytes()


def test_environments_and_vectors_of_them_take_it():
    env = SafetyFilter(gym.make("HCBF-Regions-v0", scenario="random"), strict="gatekeeper")
    envs = VectorSafetyFilter(
        gym.make_vec("HCBF-Regions-v0", num_envs=2, scenario="random"), strict="gatekeeper"
    )
    env.reset(seed=0)
    envs.reset(seed=0)
    for _ in range(50):
        info = env.step(np.array([5.0, 5.0], dtype=np.float32))[4]["safety_filter"]
        others = envs.step(np.full((2, 2), 5.0, dtype=np.float32))[4]["safety_filter"]
        assert info["u_safe"].tobytes() == others["u_safe"][0].tobytes()
        assert info["verified"] > 0
    assert gym.make(env.spec).get_wrapper_attr("_core").config.gate.directions == 16
    env.close()
    envs.close()


def function(x, t):
    """Return h of a condition of one's own."""
    return 1.0 - x[0]


@pytest.mark.parametrize(
    ("make", "match"),
    [
        pytest.param(
            lambda: filtered([Function("mine", 1, function)]), 'strict="rows"', marks=needs("jax")
        ),
        (lambda: hcbf_gym.BatchFilter(BOX, T, strict="gate"), "expected one of"),
        (lambda: hcbf_gym.BatchFilter(BOX, T, strict={"kinds": 1}), "unknown option"),
        (lambda: hcbf_gym.BatchFilter(BOX, T, strict={"directions": 0}), "directions"),
        (lambda: hcbf_gym.BatchFilter(BOX, T, strict={"manoeuvres": ["no"]}), "manoeuvre"),
        (lambda: hcbf_gym.BatchFilter(Box((0, -1), (1, 1)), T, strict="gatekeeper"), "inside it"),
        (lambda: gatekeeper.register("x", 3), "function"),
        (lambda: Shapes("s", 1, "disc", [[0, 0, 1]], moves_for=-1.0), "moves_for"),
    ],
)
def test_what_is_not_verified_is_refused_with_the_remedy(make, match):
    with pytest.raises((InvalidInputError, UnknownNameError), match=match):
        make()
