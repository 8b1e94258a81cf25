"""A plant in survey coordinates is filtered as one near the origin, whatever its model is."""

import numpy as np
import pytest

import hcbf_gym
from hcbf_gym import Estimate, Plant, models
from hcbf_gym.barriers import (
    BarrierSet,
    Disc,
    Function,
    HalfPlane,
    Shapes,
    SpeedLimit,
)
from hcbf_gym.errors import SafetyWarning
from hcbf_gym.models import Axle, Box, Reason
from hcbf_gym.programs import FilterStatus
from hcbf_gym.wrappers import SafetyFilter
from hcbf_robots.maps import Grid, MapClass, RankedMap
from tests.filtering.cores import core_of
from tests.worlds import OwnDisc, World

T, UTM = 0.05, (500_000.0, 5_900_000.0)
MODELS = {
    "planar": models.DoubleIntegrator(),
    "cart": models.DoubleIntegrator(),
    "drag": models.DoubleIntegrator(drag=0.5),
    "velocities": models.SingleIntegrator(),
    "unicycle": models.Unicycle(),
    "bicycle": models.KinematicBicycle(),
}


def scene(name, x, y):
    """Conditions around a place, of every kind that a model takes."""
    if name in ("unicycle", "bicycle"):  # conditions that both inputs enter as early
        jnp = pytest.importorskip("jax.numpy")

        def ahead(x, _, center):
            place = x[:2] + 0.3 * jnp.stack([jnp.cos(x[2]), jnp.sin(x[2])])
            slow = 0.2 * x[3] if name == "bicycle" else 0.0
            return jnp.hypot(*(place - center)) - 0.4 - slow

        return [Function("disc", 1, ahead, parameters=np.array([x + 1.5, y + 0.2]))]
    found = [
        Disc("disc", 1, (x + 1.5, y + 0.2), 0.4, velocity=(-0.1, 0.0)),
        HalfPlane("wall", 1, (-0.6, 0.8), -0.6 * (x + 2.0) + 0.8 * (y - 1.0)),
        Disc("lawn", 2, (x + 0.5, y + 1.0), 0.6),
    ]
    if name in ("planar", "cart"):
        cells = np.zeros((40, 40), dtype=bool)
        cells[:, -1] = True
        grid = Grid(0.1, (x - 1.0, y - 2.0, 0.1), (40, 40))
        found.append(RankedMap(grid, (MapClass("walls", 1, "keepout", cells),)))
        found.append(Shapes("scan", 2, "disc", [(x + 1.0, y - 1.0, 0.1)]))
        found += [OwnDisc("post", 2, (x + 0.7, y - 0.9), 0.3), SpeedLimit("cap", 1, 1.2)]
    return found


def run(name, x, y, count, guided=False):
    """Drive; return inputs, reports and where the plants are, counted from (x, y)."""
    model = MODELS[name]
    axle = Axle(0.2, 1.0, 1.5, 2.0) if name == "cart" else None
    u_set = Box.symmetric(2.0, model.n_u)
    brake = np.zeros(model.n_u) if name in ("unicycle", "bicycle") else None
    plant = Plant(model, lambda *_: (), lambda *_: (), u_set, period=T, axle=axle, brake=brake)
    core = core_of(plant, count=count, guidance="geodesic" if guided else None)
    n = 1 if count is None else count
    barriers = scene(name, x, y)
    if guided:
        barriers = [one for one in barriers if not isinstance(one, OwnDisc)]
    away = np.zeros(model.n)
    away[:2] = x, y
    here = np.zeros((n, model.n))
    here[:, 1] = 0.1 * np.arange(n)
    rng, reports, inputs = np.random.default_rng(0), [], []
    goal = np.array([x + 2.0, y + 0.5])

    def known(k):
        state = here + away
        lag = np.full_like(state, 0.001)
        part = state if count is not None else state[0]
        heading = np.zeros(n) if count is not None else 0.0
        now = np.full(n, k * T) if count is not None else k * T
        return Estimate(part, now, heading=heading if axle else None, model=part.copy(),
                        lag=lag if count is not None else lag[0])  # fmt: skip

    core.restart(np.ones(n, dtype=np.bool_))
    core.cover(0)
    core.begin(barriers, known(0), goal, None)
    for k in range(30):
        wanted = rng.uniform(-2.0, 2.0, (n, model.n_u)) + 0.5
        world = (goal, None) if guided else None
        u, report = core.step(wanted if count else wanted[0], barriers, known(k), world)
        reports.append(report)
        inputs.append(np.atleast_2d(u))
        if name != "cart":
            here = np.array([model.step(*pair, T) for pair in zip(here, inputs[-1], strict=True)])
    return np.array(inputs), reports, here


@pytest.mark.parametrize("count", [None, 3])
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.filterwarnings("ignore")
def test_survey_coordinates_change_nothing(name, count):
    near, far = (run(name, *place, count) for place in ((0.0, 0.0), UTM))
    np.testing.assert_allclose(far[0], near[0], atol=1e-5)
    np.testing.assert_allclose(far[2], near[2], atol=1e-5)
    for one, other in zip(far[1], near[1], strict=True):
        np.testing.assert_array_equal(one["status"], other["status"])
        np.testing.assert_array_equal(one["reason"], other["reason"])
        np.testing.assert_allclose(one["h"], other["h"], atol=1e-5)
        np.testing.assert_allclose(one["margin"], other["margin"], atol=1e-6)
    assert {int(s) for r in far[1] for s in np.atleast_1d(r["status"])} & {0, 1, 2}


@pytest.mark.parametrize("count", [None, 3])
@pytest.mark.filterwarnings("ignore")
def test_guidance_leads_there(count):
    near, far = (run("planar", *place, count, guided=True) for place in ((0.0, 0.0), UTM))
    np.testing.assert_allclose(far[0], near[0], atol=1e-3)
    reasons = [
        {int(r) for one in run[1] for r in np.atleast_1d(one["reason"])} for run in (near, far)
    ]
    assert reasons[0] == reasons[1]
    assert not reasons[1] & {Reason.STATE, Reason.BARRIERS, Reason.GOAL}, reasons


class Boat(World):
    """A double integrator in survey coordinates, which notes where it was braked."""

    def __init__(self, barriers, static=True):
        def brake(x):
            self.braked_at = np.array(x)
            return np.zeros(2)

        super().__init__(period=T, limit=2.0, start=[*UTM, 0.0, 0.0])
        self.seen = lambda: self.x.copy()
        self.plant = hcbf_gym.Plant(
            models.DoubleIntegrator(), barriers if static else lambda *_: barriers,
            lambda env, *_: env.seen(), period=T, brake=brake,
        )  # fmt: skip


@pytest.mark.parametrize("static", [True, False])
def test_a_wrapper_stops_before_a_wall_there_and_again_elsewhere(static):
    wall = HalfPlane("wall", 1, (-1.0, 0.0), -(UTM[0] + 2.0))
    env = Boat([wall], static=static)
    safe = SafetyFilter(env)
    for at in (UTM, (UTM[0] - 1500.0, UTM[1] + 2000.0), UTM):
        env.start[:2] = at
        safe.reset()
        for _ in range(200):
            report = safe.step(np.array([2.0, 0.0]))[4]["safety_filter"]
            assert report["status"] != FilterStatus.BACKUP
            np.testing.assert_allclose(report["h"], wall.h(env.x) - 0.0, atol=1.0)
    assert UTM[0] + 1.5 < env.x[0] <= UTM[0] + 2.0


def test_a_brake_gets_the_state_as_the_plant_gives_it():
    env = Boat([Disc("disc", 1, (UTM[0] + 3.0, UTM[1]), 0.5)])
    safe = SafetyFilter(env)
    safe.reset()
    safe.step(np.zeros(2))
    env.seen = lambda: np.full(4, np.nan)
    with pytest.warns(SafetyWarning):
        safe.step(np.zeros(2))
    np.testing.assert_allclose(env.braked_at, env.x, atol=1e-6)


@pytest.mark.filterwarnings("ignore:.*brakes until")
def test_what_cannot_be_moved_stops_the_robot_with_a_warning():
    disc = Disc("disc", 1, (UTM[0] + 3.0, UTM[1]), 0.5)
    scenes = BarrierSet([[disc]], is_placed=True)
    safe = SafetyFilter(Boat(scenes, static=False))
    with pytest.warns(SafetyWarning, match="far from the origin: got the scenes of"):
        safe.reset()
    assert safe.step(np.ones(2))[4]["safety_filter"]["reason"] == Reason.BARRIERS


@pytest.mark.filterwarnings("ignore:.*brakes until")
def test_an_invalid_state_does_not_decide():
    env = Boat([Disc("disc", 1, (UTM[0] + 3.0, UTM[1]), 0.5)])
    seen, env.seen = env.seen, lambda: Estimate(np.zeros(4), age=np.inf)
    safe = SafetyFilter(env)
    safe.reset()
    safe.step(np.zeros(2))
    env.seen = seen
    assert safe.step(np.zeros(2))[4]["safety_filter"]["reason"] == Reason.NONE
