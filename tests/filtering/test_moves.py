"""A region that is nearer than its declared velocity explains is named, from any API."""

import itertools
import warnings

import numpy as np
import pytest
from needs import needs

from hcbf_gym import BatchFilter
from hcbf_gym.barriers import Disc, Function, HalfPlane, Shapes
from hcbf_gym.errors import SafetyWarning
from hcbf_gym.models import Box, Reason, Uncertainty
from hcbf_gym.programs import FilterStatus
from tests.filtering.test_time_of_shapes import WAYS, T

FAST = 0.35
"""At which regions come nearer [m/s]."""
WITHIN = round(0.5 / T)


def quietly(call, *arguments):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return call(*arguments)


def reasons(filt, lists):
    """Return the reasons of steps with these lists, one after the other."""
    found = [int(quietly(filt.begin, lists[0])["reason"])]
    return found + [int(quietly(filt.step, listed)["reason"]) for listed in lists[1:]]


def near(x, t, p):
    """Return h of a disc around p, for a `Function`."""
    import jax.numpy as jnp

    return jnp.hypot(x[0] - p[0], x[1] - p[1]) - 0.5


MAKES = {
    "disc": lambda at, w: Disc("it", 1, (at, 0.5), 0.5, (w, 0.0)),
    "wall": lambda at, w: HalfPlane("it", 1, (-1.0, 0.0), -at),
    "function": lambda at, w: Function("it", 1, near, parameters=[at, 0.5]),
}


@pytest.mark.parametrize(
    ("make", "way"),
    [
        *itertools.product(("disc", "wall"), WAYS),
        *(pytest.param("function", way, marks=needs("jax")) for way in WAYS if "list" in way),
    ],
)
def test_motion_without_a_velocity_is_reported_in_half_a_second_and_then_ends(way, make):
    made, filt = MAKES[make], WAYS[way]()
    comes = [[made(6.0 - FAST * T * k, 0.0)] for k in range(2 * WITHIN)]
    rests = [[made(6.0 - FAST * T * 2 * WITHIN, 0.0)] for _ in range(round(4.0 / T))]
    found = reasons(filt, comes + rests)
    assert Reason.MOVES in found[: WITHIN + 1]
    first = found.index(Reason.MOVES)
    assert set(found[first : len(comes)]) == {Reason.MOVES}  # as long as it moves
    assert found[-1] == 0
    assert set(found) == {0, Reason.MOVES}


@pytest.mark.parametrize("way", WAYS)
def test_motion_with_a_velocity_and_motion_away_are_not_reported(way):
    w = -FAST
    with_velocity = [[Disc("it", 1, (6.0 + w * T * k, 0.5), 0.5, (w, 0.0))] for k in range(30)]
    away = [[Disc("it", 1, (6.0 + FAST * T * k, 0.5), 0.5)] for k in range(30)]
    for lists in (with_velocity, away):
        assert not any(reasons(WAYS[way](), lists))


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("moves", [True, False])
def test_lists_may_change_order_and_length(moves, named):
    rng = np.random.default_rng(3)
    lists = []
    for k in range(40):
        place = [(6.0 - moves * FAST * T * k, 0.0), (0.0, 7.0), (-8.0, 0.0), (0.0, -9.0)]
        discs = [
            Disc(f"person {i}" if named else "person", 1, at, 0.5) for i, at in enumerate(place)
        ]
        others = [one for one in discs[1:] if rng.random() < 0.7]
        lists.append([([discs[0], *others])[i] for i in rng.permutation(1 + len(others))])
    found = reasons(WAYS["batch, lists"](), lists)
    assert (Reason.MOVES in found[: WITHIN + 1]) == moves
    assert moves or not any(found)


def test_what_came_into_sight_did_not_move():
    far = Disc("far", 1, (9.0, 0.0), 0.5)
    for name in ("new", "far"):
        lists = [[far]] * 5 + [[far, Disc(name, 1, (0.0, 3.0), 0.5)]] * 5
        assert not any(reasons(WAYS["batch, lists"](), lists))
    wall = np.column_stack([np.full(40, 3.0), np.linspace(-4.0, 4.0, 40), np.full(40, 0.1)])
    beams = [[Shapes("scan", 1, "disc", wall + np.array([0.0, 0.02 * k, 0.0]))] for k in range(40)]
    assert not any(reasons(WAYS["wrapper, planar"](), beams))  # beams that glide along a wall


def test_arrays_that_are_set_again_are_compared():
    filt, x, found = BatchFilter(Box.symmetric(5.0), T), np.zeros(4), []
    for k in range(WITHIN):
        filt.set_scene([Shapes("it", 1, "disc", [[6.0 - FAST * T * k, 0.0, 0.5]])])
        if k == 0:
            filt.reset(x=x)
        found.append(int(quietly(filt, np.zeros(2), x)[1]["reason"]))
    assert Reason.MOVES in found


@pytest.mark.parametrize("on_alarm", ["warn", "brake"])
def test_the_step_is_not_calm_and_one_warning_an_episode_names_the_region(on_alarm):
    filt, x = BatchFilter(Box.symmetric(5.0), T, on_alarm=on_alarm), np.zeros(4)
    for _ in range(2):
        filt.set_scene([Disc("the cat", 1, (6.0, 0.0), 0.5)])
        filt.reset(x=x)
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            for k in range(WITHIN):
                filt.set_scene([Disc("the cat", 1, (6.0 - FAST * T * k, 0.0), 0.5)])
                u, report = filt(np.array([0.01, 0.0]), x)
        answers = [str(one.message) for one in raised if one.category is SafetyWarning]
        moves = [one for one in answers if "velocity=(vx, vy)" in one]
        assert len(moves) == 1
        assert "'the cat'" in moves[0]
        assert report["reason"] == Reason.MOVES
        brakes = on_alarm == "brake"
        assert (report["status"] == FilterStatus.BACKUP) == brakes
        assert u[0] == (0.0 if brakes else 0.01)
        for _ in range(round(4.0 / T)):
            u, report = quietly(filt, np.array([0.01, 0.0]), x)
        assert (report["status"], report["reason"]) == (FilterStatus.NOMINAL, 0)
        assert u[0] == 0.01


NOISE = 0.02
"""By how much a position is off at most [m]; of normal errors three deviations."""


def uniform(rng, shape):
    turn, far = rng.uniform(0.0, 2.0 * np.pi, shape), np.sqrt(rng.uniform(0.0, 1.0, shape))
    return NOISE * far[..., None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)


def normal(rng, shape):
    return NOISE / 3.0 * rng.normal(size=(*shape, 2))


def tracked(places, radius, velocity, named):
    """Return what a tracker gives of N robots' discs (N, m): arrays, or lists of named discs."""
    if not named:
        numbers = np.concatenate([places, radius[..., None]], axis=2)
        return [Shapes("people", 1, "disc", numbers, velocity)]
    return [
        [Disc(f"person {k}", 1, *one) for k, one in enumerate(zip(*row, strict=True))]
        for row in zip(places.tolist(), radius.tolist(), velocity.tolist(), strict=True)
    ]


@pytest.mark.parametrize("errors", [uniform, normal])
@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("declares", [False, True])
def test_no_region_that_is_tracked_with_errors_is_entered_calmly(declares, named, errors):
    """Discs rest for 1 s, which is no motion, and drive at the robots then."""
    rng, x, period, rests, n = np.random.default_rng(7), np.zeros((40, 4)), 0.05, 20, 40
    turn, far = rng.uniform(0.0, 2.0 * np.pi, (n, 3)), rng.uniform(3.0, 6.0, (n, 3))
    place = far[..., None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    radius, speed = rng.uniform(0.2, 0.6, (n, 3)), rng.uniform(0.3, 1.0, (n, 3, 1))
    filt, w = (
        BatchFilter(Box.symmetric(5.0), period, n, uncertainty=Uncertainty(NOISE)),
        0.0 * place,
    )
    moved, entered, delay = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool), np.full(n, np.inf)
    for step in range(160):
        seen = place + errors(rng, (n, 3))
        filt.set_scene(tracked(seen, radius, w if declares else 0.0 * w, named))
        if step == 0:
            quietly(lambda: filt.reset(x=x))
        u, report = quietly(filt, np.clip(-4.0 * x[:, 2:] - x[:, :2], -5.0, 5.0), x)
        moved |= report["reason"] == Reason.MOVES
        assert not (moved.any() and (declares or step < rests))
        delay = np.where(moved & np.isinf(delay), (step - rests) * period, delay)
        x[:, :2] += period * x[:, 2:] + 0.5 * period**2 * u
        x[:, 2:] += period * u
        place = place + period * w
        inside = (np.linalg.norm(x[:, None, :2] - place, axis=2) < radius).any(axis=1)
        calm = (report["status"] <= FilterStatus.RELAXED) & (report["reason"] == 0)
        assert not (inside & ~entered & calm).any()
        entered |= inside
        assert declares or moved[inside].all()
        if step >= rests:
            to = x[:, None, :2] - place
            w = speed * to / np.linalg.norm(to, axis=2, keepdims=True)
    assert declares or (entered.any() and np.mean(delay <= 0.5) >= 0.95)
