"""A plant in a batch is filtered as alone, however long the scenes of the others are."""

from collections import Counter

import numpy as np
import pytest

import hcbf_gym
from hcbf_gym import Estimate, Plant, models, programs
from hcbf_gym.barriers import (
    Capsule,
    ConvexPolygon,
    Disc,
    Ellipse,
    HalfPlane,
    Shapes,
    SpeedLimit,
)
from hcbf_gym.errors import InvalidInputError, SafetyWarning
from hcbf_gym.models import Axle, Box, Uncertainty
from hcbf_gym.programs import FilterStatus
from hcbf_robots.maps import Grid, MapClass, RankedMap
from tests.filtering.cores import core_of
from tests.worlds import OwnDisc

PLANTS, STEPS, T = 24, 12, 0.05
PROGRAMS = (
    *programs.names(),
    {"strict": "all", "lower": "relaxed", "order": "by level", "lock": "pin"},
)
"""Of the registered plans, and one that pins what rows of equal rank pay."""
NOTHING = {"slack": 0.0, "delta": 0.0, "margin": 0.0, "conditioning": 0.0, "h": np.inf}
NOTHING |= {"psi": np.inf}
"""What is reported of a place that no condition takes."""


def robots():
    """name → model, axle, number of inputs, uncertainty, guidance that there is, solver."""
    uncertain = Uncertainty(distance=0.02, per_velocity=0.1, cap=0.05, body=0.1, speed=0.02)
    placed = Uncertainty(distance=0.02, body=0.1)
    point, led = models.DoubleIntegrator(), (None, "geodesic", "local", "through")
    return {
        "point": (point, None, 2, Uncertainty(), led, None),
        "uncertain": (point, None, 2, uncertain, led, None),
        "cart": (point, Axle(0.2, 1.0, 1.5, 2.0), 2, uncertain, led[:2], None),
        "drag": (models.DoubleIntegrator(drag=0.5), None, 2, uncertain, (None,), None),
        "velocities": (models.SingleIntegrator(), None, 2, placed, (None,), None),
        "three inputs": (models.DoubleIntegrator(3), None, 3, Uncertainty(), (None,), "daqp"),
    }


ROBOTS = robots()


def a_map(rng):
    """The conditions of a small map with a zone and a keepout of a lower rank."""
    walls, lawn, slow = (rng.random((24, 24)) < share for share in (0.03, 0.1, 0.1))
    classes = (
        MapClass("walls", 1, "keepout", walls),
        MapClass("lawn", 3, "keepout", lawn),
        MapClass("slow", 2, "speed", slow, limit=0.9),
    )
    return RankedMap(Grid(0.25, (-3.0, -3.0, 0.0), (24, 24)), classes).conditions


def a_condition(rng, k, x, robot):
    """A condition near x, of any rank and kind."""
    rank = int(rng.choice([1, 1, 2, 3, 5, 9]))
    name, moving = f"{k}", tuple(rng.uniform(-0.3, 0.3, 2) * (rng.random() < 0.3))
    center = tuple(x[:2] + rng.uniform(-1.5, 1.5, 2))
    size, turn = tuple(rng.uniform(0.2, 0.7, 2)), float(rng.uniform(0.0, np.pi))
    n = (float(np.cos(2.0 * turn)), float(np.sin(2.0 * turn)))
    planar = isinstance(ROBOTS[robot][0], models.DoubleIntegrator) and ROBOTS[robot][2] == 2
    kind = rng.integers(9 if planar and robot != "drag" else 6)
    match kind:
        case 0:
            return Disc(name, rank, center, size[0], moving)
        case 1:
            return HalfPlane(name, rank, n, float(np.dot(n, x[:2]) - rng.uniform(-0.1, 1.0)))
        case 2:
            return Ellipse(name, rank, center, size, turn, moving)
        case 3:
            return Capsule(name, rank, center, (center[0] + n[0], center[1] + n[1]), 0.2, moving)
        case 4:
            corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * 0.5 * size + center
            return ConvexPolygon(name, rank, tuple(map(tuple, corners.tolist())), moving)
        case 5:
            if robot in ("velocities", "three inputs"):
                return Disc(name, rank, center, size[1])
            return SpeedLimit(name, rank, float(rng.uniform(0.9, 1.5)))
        case 6:
            values = [(*(x[:2] + rng.uniform(-1.5, 1.5, 2)), 0.1) for _ in range(3)]
            return Shapes(name, rank, "disc", values, moving)
        case 7:
            return OwnDisc(name, rank, center, 0.4)
        case _:
            return SpeedLimit(name, 1, float(rng.uniform(0.9, 1.5)))


def a_batch(rng, robot, guidance):
    """States, scenes and goals of `PLANTS` plants."""
    n = ROBOTS[robot][0].n
    x = rng.uniform(-1.5, 1.5, (PLANTS, n))
    x[:, 2:] *= 0.6
    mapped = robot in ("point", "uncertain", "cart") and rng.random() < 0.3
    of_map = a_map(rng) if mapped else ()
    scenes = []
    for i in range(PLANTS):
        scene = [a_condition(rng, k, x[i], robot) for k in range(rng.integers(0, 7))]
        if guidance in ("geodesic", "through"):
            scene = [one for one in scene if not isinstance(one, OwnDisc)]
        if mapped and rng.random() < 0.5:
            scene.extend(of_map)
        scenes.append(scene)
    if guidance not in ("geodesic", "through"):
        return x, scenes, np.zeros((PLANTS, 2))
    return x, scenes, np.array([a_goal(rng, *pair) for pair in zip(x, scenes, strict=True)])


def a_goal(rng, x, scene):
    """A place near x that lies in no strict region; the last of those is left out if need be."""
    while True:
        for _ in range(20):
            goal = np.array([*(x[:2] + rng.uniform(-1.0, 1.0, 2)), 0.0, 0.0])
            listed = [one for one in scene if not isinstance(one, Shapes) and one.priority == 1]
            if min((one.h(goal) for one in listed), default=1.0) > 0.2:
                return goal[:2]
        scene.remove(listed[-1])


def filter_of(robot, program, guidance, batch):
    """A filter of one plant, or of a batch."""
    model, axle, n_u, uncertainty, _, solver = ROBOTS[robot]
    u = Box.symmetric(3.0, n_u)
    plant = Plant(model, lambda *_: (), lambda *_: (), u, period=T, uncertainty=uncertainty,
                  axle=axle)  # fmt: skip
    led = {"kind": "geodesic", "through": 2} if guidance == "through" else guidance
    return core_of(plant, program, batch, guidance=led, solver=solver)


def estimate(rng, robot, x, t):
    """What is known of plants at states x, of which some are not finite."""
    known = Estimate(x, np.full(len(x), t))
    if ROBOTS[robot][1] is not None:
        known = known._replace(heading=np.arctan2(x[:, 3], x[:, 2]))
    if ROBOTS[robot][3].distance > 0.0 and rng.random() < 0.5:
        deviations = rng.uniform(0.0, 0.02, x.shape)
        known = known._replace(
            covariance=np.array([np.diag(one**2) for one in deviations]),
            lag=rng.normal(0.0, 0.01, x.shape),
        )
    if rng.random() < 0.2:
        known.x[rng.integers(len(x)), 0] = np.nan
    return known


def of_one(known, i):
    """What is known of plant i."""
    return Estimate(*(None if part is None else part[i] for part in known))


def compare(alone, together, i, scenes):
    """Fail where the report of one plant is not that of plant i of a batch."""
    m = sum(len(b) if isinstance(b, Shapes) else 1 for b in scenes[i])
    for key, value in alone.items():
        whole = together[key][i]
        of_rows = key in NOTHING
        np.testing.assert_array_equal(value, whole[:m] if of_rows else whole, err_msg=key)
        if of_rows:
            np.testing.assert_array_equal(whole[m:], NOTHING[key], err_msg=f"{key} of nothing")


def compare_batch(seed, robot, program, guidance):
    """Filter one batch and as many single plants; return how often there was which status."""
    rng = np.random.default_rng([49, seed])
    x, scenes, goals = a_batch(rng, robot, guidance)
    batch = filter_of(robot, program, guidance, PLANTS)
    one = filter_of(robot, program, guidance, None)
    counts = Counter()
    inputs = rng.uniform(-3.5, 3.5, (STEPS, PLANTS, ROBOTS[robot][2]))
    known = [estimate(rng, robot, x.copy(), 0.0)]
    batch.restart(np.ones(PLANTS, dtype=np.bool_))
    batch.cover(0)
    try:
        reports = [batch.begin(scenes, known[0], goals, None)]
    except InvalidInputError:  # a goal within a strict region
        return counts
    path, applied, seen = [x.copy()], [], []
    for k in range(STEPS):
        if k in (4, 8):  # some scenes change, those of the others stay
            others = a_batch(rng, robot, "geodesic" if guidance else None)[1]
            changed = rng.random(PLANTS) < 0.3
            scenes = [b if new else a for a, b, new in zip(scenes, others, changed, strict=True)]
        seen.append(scenes)
        known.append(estimate(rng, robot, path[-1].copy(), k * T))
        u, report = batch.step(inputs[k], scenes, known[-1])
        reports.append(report)
        applied.append(u)
        model = ROBOTS[robot][0]
        path.append(np.array([model.step(*pair, T) for pair in zip(path[-1], u, strict=True)]))
        counts.update(report["status"].tolist())
    for i in range(PLANTS):
        one.restart(np.ones(1, dtype=np.bool_))
        one.cover(0)
        compare(one.begin(seen[0][i], of_one(known[0], i), goals[i], None), reports[0], i, seen[0])
        for k in range(STEPS):
            u, report = one.step(inputs[k, i], seen[k][i], of_one(known[k + 1], i))
            np.testing.assert_array_equal(u, applied[k][i])
            compare(report, reports[k + 1], i, seen[k])
    return counts


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.filterwarnings("ignore")
def test_a_batch_of_unequal_scenes_is_as_many_single_filters(robot):
    place = list(ROBOTS).index(robot)
    total = 0
    for turn in range(len(PROGRAMS)):
        guidance = ROBOTS[robot][4]
        led = guidance[turn % len(guidance)]
        total += compare_batch(100 * place + turn, robot, PROGRAMS[turn], led).total()
    assert total >= 4 * PLANTS * STEPS


def test_a_fast_robot_is_not_braked_by_filled_places():
    x = np.zeros((2, 4))
    x[1, 2] = 11.0
    filt = hcbf_gym.BatchFilter(Box.symmetric(5.0), 0.02, 2)
    filt.set_scene([[Disc("disc", 1, (3.0, 0.0), 0.5), HalfPlane("wall", 2, (0.0, 1.0), -3.0)], []])
    filt.reset(x=x)
    u, report = filt(np.array([[0.0, 0.0], [5.0, 0.0]]), x)
    np.testing.assert_array_equal(u[1], [5.0, 0.0])
    assert report["status"][1] == FilterStatus.NOMINAL
    np.testing.assert_array_equal(report["h"][1], np.inf)
    np.testing.assert_array_equal(report["margin"][1], 0.0)
    assert [tuple(one) for one in filt.conditions(1)] == [("nothing", 0)] * 2


@pytest.mark.filterwarnings("ignore")
def test_a_region_that_is_gone_moves_no_longer_whatever_the_other_plants_see():
    program = PROGRAMS[37 // len(ROBOTS) % len(PROGRAMS)]
    assert compare_batch(37, "uncertain", program, "local").total() > 0


@pytest.mark.filterwarnings("ignore")
def test_a_plant_that_was_too_fast_is_unsafe_no_longer_than_its_speed_lasts():
    program = PROGRAMS[363 // len(ROBOTS) % len(PROGRAMS)]
    assert compare_batch(363, "drag", program, None).total() > 0


FAR = 1.5


class Failing(OwnDisc):
    """A user's own that raises at one place."""

    def jet(self, x, t=0.0):
        if x[0] == FAR:
            raise ValueError("far")
        return super().jet(x, t)


def test_a_plant_alone_brakes_where_its_own_condition_raises():
    plant = Plant(
        models.DoubleIntegrator(drag=0.5),
        lambda *_: (),
        lambda *_: (),
        Box.symmetric(3.0, 2),
        period=T,
    )
    core = core_of(plant, "lex-cbf-qp", 3)
    failing = Failing("c", 1, (0.0, -5.0), 0.5)
    scenes = [[Disc("a", 1, (3.0, 0.0), 0.5), OwnDisc("b", 2, (0.0, 5.0), 0.5)], [failing], []]
    x = np.zeros((3, 4))
    core.restart(np.ones(3, dtype=np.bool_))
    core.cover(0)
    core.begin(scenes, Estimate(x, np.zeros(3)), None, None)
    x[1, 0] = FAR
    with pytest.warns(SafetyWarning, match="of 3 plants|far"):
        _, report = core.step(np.ones((3, 2)), scenes, Estimate(x, np.full(3, T)))
    assert (report["status"] == FilterStatus.BACKUP).tolist() == [False, True, False]
