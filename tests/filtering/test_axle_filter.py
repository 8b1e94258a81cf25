"""The filter of a differential drive, in a loop with an exact axle."""

import sys

import numpy as np
import pytest

from hcbf_gym import Estimate, Plant, _core
from hcbf_gym.barriers import BarrierSet, ConvexPolygon, Disc, HalfPlane, SpeedLimit, layout
from hcbf_gym.barriers.speed_limit import least_limit
from hcbf_gym.errors import InvalidInputError, SafetyWarning
from hcbf_gym.models import Axle, Box, DoubleIntegrator, Reason, SingleIntegrator, Uncertainty
from hcbf_gym.programs import FilterStatus
from hcbf_robots.maps import Grid, MapClass, RankedMap
from tests.filtering.cores import core_of

CART = Axle(look_ahead=0.25, forward=0.5, turn=1.82, braking=1.5)
PERIOD, BODY = 0.05, 0.34
ROOM = [
    HalfPlane("left", 1, (0.0, -1.0), -2.0),
    HalfPlane("right", 1, (0.0, 1.0), -2.0),
    HalfPlane("back", 1, (1.0, 0.0), -2.5),
    HalfPlane("front", 1, (-1.0, 0.0), -2.5),
]


def filter_of(barriers, *, axle=None, limit=None, body=BODY, program="lex-cbf-qp", **options):
    axle = axle or CART
    plant = Plant(
        DoubleIntegrator(), barriers, lambda *_: None, Box.symmetric(limit or axle.braking),
        period=PERIOD, uncertainty=Uncertainty(body=body), axle=axle,
    )  # fmt: skip
    return core_of(plant, program, **options)


class Cart:
    """An axle that follows its input at once."""

    def __init__(self, place, heading):
        self.place, self.heading = np.array(place, dtype=float), float(heading)
        self.v = self.turning = self.time = 0.0

    @property
    def axes(self):
        e = np.array([np.cos(self.heading), np.sin(self.heading)])
        return e, np.array([-e[1], e[0]])

    @property
    def x(self):
        e, across = self.axes
        velocity = self.v * e + CART.look_ahead * self.turning * across
        return np.concatenate([self.place + CART.look_ahead * e, velocity])

    def estimate(self):
        return Estimate(self.x, self.time, heading=self.heading)

    def hold(self, u):
        """Return the axle's places (10, 2) of one period."""
        e, across = self.axes
        self.v += PERIOD * u @ e
        self.turning += PERIOD / CART.look_ahead * (u @ across)
        places = []
        for _ in range(10):
            self.heading += 0.05 * PERIOD * self.turning
            self.place = self.place + 0.1 * PERIOD * self.v * self.axes[0]
            self.heading += 0.05 * PERIOD * self.turning
            places.append(self.place)
        self.time += PERIOD
        return np.array(places)


def begun(core, barriers, cart, goal=None):
    core.restart(np.ones(1, dtype=np.bool_))
    return core.begin(barriers, cart.estimate(), goal, None)


def nearest(barriers, places, time=0.0):
    """Return the least distance of places (k, 2) from regions, and the normal there."""
    x = np.pad(places, ((0, 0), (0, 2)))
    h, sensed = BarrierSet([barriers] * len(x)).sense(x, np.full(len(x), time))
    k = np.unravel_index(h.argmin(), h.shape)
    return h.min(), sensed[k][1:3]


@pytest.mark.parametrize("attack", ["nearest", "along", "bang", "back"])
def test_a_hostile_cart_enters_nothing_that_stands(attack):
    rng = np.random.default_rng(len(attack))
    met = 0
    for _ in range(4):
        discs = []
        while len(discs) < 4:
            at, radius = rng.uniform(-1.8, 1.8, 2), rng.uniform(0.1, 0.4)
            if np.hypot(*at) > radius + 0.5:
                discs.append(Disc(f"disc {len(discs)}", 1, tuple(at), radius))
        barriers = [*ROOM, *discs]
        core, cart = filter_of(barriers), Cart((0.0, 0.0), rng.uniform(-3.0, 3.0))
        begun(core, barriers, cart)
        bang = np.zeros(2)
        for step in range(160):
            _, n = nearest(barriers, cart.place[None])
            e, _ = cart.axes
            if step % 8 == 0:
                bang = 4.0 * rng.choice([-1.0, 1.0], 2)
            asked = {
                "nearest": -8.0 * n,
                "along": -8.0 * n + 8.0 * np.array([-n[1], n[0]]),
                "bang": bang,
                "back": -8.0 * e if n @ e > 0.0 else 8.0 * e,
            }[attack]
            u, report = core.step(asked, barriers, cart.estimate())
            least, _ = nearest(barriers, cart.hold(u))
            assert least >= BODY - 1e-9
            assert report["status"] < FilterStatus.VIOLATED
            met += report["status"] == FilterStatus.SAFE
            assert abs(cart.v) <= CART.forward + 1e-9
            assert abs(cart.turning) <= CART.turn + 1e-9
    assert met > 100


def test_turning_in_place_beside_a_wall_is_never_changed():
    wall = [HalfPlane("wall", 1, (-1.0, 0.0), -1.0)]
    core, cart = filter_of(wall), Cart((1.0 - BODY - 0.02, 0.0), 0.0)
    begun(core, wall, cart)
    for step in range(120):
        wanted = 1.5 if step < 60 else -1.5
        asked = CART.look_ahead * (wanted - cart.turning) / PERIOD
        u_nominal = np.clip(asked, -1.5, 1.5) * cart.axes[1]
        u, report = core.step(u_nominal, wall, cart.estimate())
        assert report["status"] == FilterStatus.NOMINAL
        np.testing.assert_allclose(u, u_nominal, atol=1e-12)
        assert report["model_error"] < 1e-9
        cart.hold(u)


@pytest.mark.parametrize("width", [0.76, 0.8])
@pytest.mark.parametrize("start", [(0.0, 0.0, 0.0), (0.2, 0.7, 1.5), (0.3, -0.6, -3.0)])
def test_a_cart_slides_into_a_doorway_that_its_circle_passes(width, start):
    half = width / 2.0
    filt = [
        ConvexPolygon("a", 1, ((2.0, half), (2.15, half), (2.15, 4.0), (2.0, 4.0))),
        ConvexPolygon("b", 1, ((2.0, -4.0), (2.15, -4.0), (2.15, -half), (2.0, -half))),
    ]
    core, cart = filter_of(filt), Cart(start[:2], start[2])
    begun(core, filt, cart)
    for _ in range(600):
        ahead = np.array([1.3 if cart.x[0] < 1.2 else 3.5, 0.0]) - cart.x[:2]
        wanted = CART.forward * ahead / np.hypot(*ahead)
        u, report = core.step(4.0 * (wanted - cart.x[2:]), filt, cart.estimate())
        least, _ = nearest(filt, cart.hold(u))
        assert least >= BODY - 1e-9
        assert report["status"] <= FilterStatus.SAFE
        if cart.place[0] > 2.6:
            return
    raise AssertionError(f"stands at {cart.place}")


def test_what_moves_is_relaxed_for_what_is_at_rest():
    wall = HalfPlane("wall", 1, (-1.0, 0.0), -1.0)
    mover = Disc("mover", 1, (-1.5, 0.0), 0.2, (0.4, 0.0))
    cart, answers, hit = Cart((0.0, 0.0), 0.0), False, False
    core = filter_of([wall, mover])
    begun(core, [wall, mover], cart)
    for _ in range(120):
        u, report = core.step(np.zeros(2), [wall, mover], cart.estimate())
        time = cart.time
        places = cart.hold(u)
        assert nearest([wall], places)[0] >= BODY - 1e-9
        h, n = nearest([mover], places[-1:], time + PERIOD)
        if h < BODY and not hit:
            hit = True
            assert answers
            assert cart.v * cart.axes[0] @ n >= -1e-6  # it does not drive at what runs into it
        answers |= report["status"] >= FilterStatus.VIOLATED
    assert answers


@pytest.mark.parametrize(
    ("program", "options"),
    [("eh-cbf-qp", {}), ("eh-cbf-qp", {"gamma0": 0.01}), ("lex-cbf-qp", {"weights": [None, 1.0]})],
)
def test_a_strict_region_that_moves_stays_strict_under_every_program(program, options):
    mover = [Disc("mover", 1, (2.5, 0.0), 0.3, (-0.3, 0.0))]
    core, cart = filter_of(mover, program=program, **options), Cart((0.0, 0.0), 0.0)
    begun(core, mover, cart)
    for _ in range(160):
        u, report = core.step(np.array([5.0, 0.0]), mover, cart.estimate())
        assert report["status"] <= FilterStatus.SAFE
        time = cart.time
        assert nearest(mover, cart.hold(u)[-1:], time + PERIOD)[0] >= BODY - 1e-9


@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")
def test_after_an_alarm_that_brakes_what_moves_pushes_it_through_no_wall():
    wall = HalfPlane("wall", 1, (-1.0, 0.0), -1.0)
    scene = [wall, Disc("mover", 1, (-1.5, 0.0), 0.2, (0.4, 0.0))]
    core, cart = filter_of(scene, on_alarm="brake"), Cart((0.0, 0.0), 0.0)
    begun(core, scene, cart)
    for step in range(120):
        fault = Reason.INPUT if step == 2 else None
        u, report = core.step(np.zeros(2), scene, cart.estimate()._replace(fault=fault))
        assert nearest([wall], cart.hold(u))[0] >= BODY - 1e-9
    assert report["status"] == FilterStatus.BACKUP


@pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning")
@pytest.mark.parametrize("begins", [(0.5, 1.82), (0.3, -1.0), (-0.4, 1.5)])
def test_without_a_heading_it_comes_to_rest(begins):
    core, cart = filter_of(ROOM), Cart((0.0, 0.0), 0.4)
    begun(core, ROOM, cart)
    cart.v, cart.turning = begins
    u, _ = core.step(np.zeros(2), ROOM, cart.estimate())
    cart.hold(u)
    for _ in range(80):
        u, report = core.step(np.zeros(2), ROOM, cart.estimate()._replace(heading=np.nan))
        cart.hold(u)
    assert report["status"] == FilterStatus.BACKUP
    assert abs(cart.v) < 0.01
    assert abs(cart.turning) < 0.02


@pytest.mark.parametrize("braking", [0.5, 1.5])
def test_a_speed_limit_is_not_passed_by_turning(braking):
    cart_of = Axle(0.25, 1.2, 2.5, braking)
    limit = [SpeedLimit("limit", 1, 0.8)]
    core, cart = filter_of(limit, axle=cart_of, limit=5.0, body=0.0), Cart((0.0, 0.0), 0.0)
    begun(core, limit, cart)
    fastest = 0.0
    for _ in range(200):
        e, across = cart.axes
        u, report = core.step(5.0 * e + 5.0 * across, limit, cart.estimate())
        cart.hold(u)
        fastest = max(fastest, abs(cart.v))
        assert report["reason"] == Reason.NONE  # an exact axle raises no alarm
    assert 0.7 < fastest <= 0.8


def test_guidance_turns_a_cart_that_faces_away():
    discs = [Disc("disc", 1, (2.0, 0.3), 0.3)]
    core, cart = filter_of(discs, guidance="geodesic"), Cart((0.0, 0.0), np.pi - 0.05)
    begun(core, discs, cart, np.array([4.0, 0.0]))
    backwards = 0.0
    for _ in range(400):
        u, _ = core.step(np.zeros(2), discs, cart.estimate())
        assert nearest(discs, cart.hold(u))[0] >= BODY - 1e-9
        backwards = min(backwards, cart.v)
        if np.hypot(*(cart.x[:2] - [4.0, 0.0])) < 0.2:
            break
    assert np.hypot(*(cart.x[:2] - [4.0, 0.0])) < 0.2
    assert backwards > -0.1


@pytest.mark.parametrize("heading", [None, np.nan, np.inf, "north", [0.0, 1.0]])
def test_a_heading_that_is_none_brakes(heading):
    core, cart = filter_of(ROOM), Cart((0.0, 0.0), 0.5)
    begun(core, ROOM, cart)
    u, _ = core.step(np.array([1.0, 0.5]), ROOM, cart.estimate())
    cart.hold(u)
    with pytest.warns(SafetyWarning, match="not finite"):
        u, report = core.step(np.array([1.0, 0.5]), ROOM, cart.estimate()._replace(heading=heading))
    assert report["status"] == FilterStatus.BACKUP
    assert report["reason"] == Reason.STATE
    corners = np.empty((4, 2))
    _core.axle_corners(CART, cart.x, 0.5, PERIOD, corners)
    assert np.abs(u).max() <= np.abs(corners).max() + 1e-9


def test_an_axle_needs_its_point_and_the_compiled_program():
    with pytest.raises(InvalidInputError, match="turns with its heading"):
        filter_of(ROOM, solver="daqp")
    with pytest.raises(InvalidInputError, match="axle"):
        Plant(SingleIntegrator(), [], lambda *_: None, period=PERIOD, axle=CART)
    with pytest.raises(InvalidInputError, match="axle without a period"):
        Plant(DoubleIntegrator(), [], lambda *_: None, axle=CART)


def zone_of(limit):
    """Return a map with a strict speed zone from 1 m to 2 m ahead."""
    cells = np.zeros((40, 60), dtype=bool)
    strip = cells.copy()
    strip[:, 30:40] = True
    return RankedMap(
        Grid(0.1, (-2.0, -2.0, 0.0), cells.shape),
        (MapClass("walls", 1, "keepout", cells), MapClass("slow", 1, "speed", strip, limit=limit)),
    )


FAST = Axle(look_ahead=0.25, forward=1.2, turn=2.5, braking=3.5)


@pytest.mark.parametrize(("more", "drive"), [(0.02, FAST), (0.06, CART), (0.2, FAST)])
@pytest.mark.parametrize("hostile", [False, True])
def test_a_cart_neither_passes_a_low_limit_nor_stands_in_its_zone(
    more, drive, hostile, monkeypatch
):
    monkeypatch.setattr(sys.modules[__name__], "CART", drive)
    least = least_limit(PERIOD, CART.braking, 0.0, CART.turn)
    limit = least + more
    rng = np.random.default_rng(0)
    scene = [zone_of(limit)]
    core, cart = filter_of(scene), Cart((0.0, 0.0), 0.0)
    begun(core, scene, cart)
    fastest, inside = 0.0, 0.0
    for step in range(2400):
        aside = rng.uniform(-6.0, 6.0) if hostile and step % 6 == 0 else 0.0
        back = cart.place[1] if not hostile else 0.0
        asked = np.array([6.0, aside - 4.0 * back - 4.0 * cart.x[3] * (not hostile)])
        u, report = core.step(asked, scene, cart.estimate())
        assert report["status"] < FilterStatus.VIOLATED
        cart.hold(u)
        if 1.0 + BODY < cart.place[0] < 2.0 and abs(cart.place[1]) < 1.9:
            fastest = max(fastest, abs(cart.v))
            inside = max(inside, abs(cart.v))
        if cart.place[0] > 2.0 or abs(cart.place[1]) > 1.9:
            break
    assert fastest <= limit + 1e-9
    if not hostile:
        assert cart.place[0] > 2.0
        assert inside > 0.5 * more


def test_limits_that_no_cart_can_hold_are_refused():
    scene = [zone_of(least_limit(PERIOD, CART.braking, 0.0, CART.turn) - 1e-3)]
    with pytest.raises(InvalidInputError, match="speed zone"):
        begun(filter_of(ROOM), scene, Cart((0.0, 0.0), 0.0))


def test_an_axle_that_brakes_harder_than_its_input_set_is_refused():
    def core(braking, input_set, given=True):
        plant = Plant(
            DoubleIntegrator(), ROOM, lambda *_: None, input_set if given else None,
            period=PERIOD, axle=CART._replace(braking=braking),
        )  # fmt: skip
        return core_of(plant, input_set=input_set)

    core(1.5, Box.symmetric(1.5))
    with pytest.raises(InvalidInputError, match=r"axle: .* larger U"):
        core(3.0, Box.symmetric(1.5))
    core(1.0, Box.symmetric(1.5), given=False)  # an action space
    with pytest.raises(InvalidInputError, match=r"axle: .*along and across"):
        core(1.5, Box.symmetric(1.5), given=False)


@pytest.mark.parametrize("offset", np.linspace(0.0, 0.05, 6).tolist())
def test_guidance_leads_through_the_gaps_that_rows_pass_and_through_no_narrower_ones(offset):
    core = filter_of(ROOM, guidance="geodesic")
    passes = 2.0 * (core.config.clearance + 0.5 * core.config.cell)
    assert 2.0 * BODY < passes < 0.76
    for width, through in ((passes + 0.01, 0), (passes - 2.0 * core.config.cell, 1)):
        low, high = offset - 0.5 * width, offset + 0.5 * width
        filt = [
            ConvexPolygon("a", 1, ((1.0, high), (1.15, high), (1.15, 4.0), (1.0, 4.0))),
            ConvexPolygon("b", 1, ((1.0, -4.0), (1.15, -4.0), (1.15, low), (1.0, low))),
        ]
        barriers, cart = [*ROOM, *filt], Cart((-1.0, 0.5), 0.5)
        core = filter_of(barriers, guidance="geodesic")
        assert begun(core, barriers, cart, (2.0, 0.0))["reachable"] == through
        for _ in range(500 * (through == 0)):
            u, _ = core.step(np.zeros(2), barriers, cart.estimate())
            least, _ = nearest(barriers, cart.hold(u))
            assert least >= BODY - 1e-9
        assert through == 1 or cart.place[0] > 1.3


def test_a_guided_cart_keeps_off_edges_and_not_off_speeds_or_conditions_of_ones_own():
    """An own gradient has any length, and may be of the velocity."""
    scene = BarrierSet([[*ROOM, Disc("disc", 1, (2.0, 0.3), 0.3), SpeedLimit("limit", 1, 0.8)]])
    assert [_core.is_edge(kind) for kind in scene.kind[0].tolist()] == [True] * 5 + [False]
    assert not _core.is_edge(layout.CUSTOM)
    assert not _core.is_edge(layout.ZONE)
