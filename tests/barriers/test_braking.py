"""Whether U can brake what the rows request, and what is reported where it cannot."""

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import scenarios, wrappers
from hcbf_gym.barriers import (
    BarrierSet,
    BrakeClassK,
    Disc,
    Ellipse,
    HalfPlane,
    LinearClassK,
    LogClassK,
    RowSettings,
    SpeedLimit,
    braking,
)
from hcbf_gym.barriers.braking import check_limits
from hcbf_gym.barriers.planar_rows import planar_rows
from hcbf_gym.barriers.shortcomings import shortcomings
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.models import Ball, Box

PERIOD = 0.02
POND = Disc("pond", 1, (3.0, 0.0), 1.0)


def held(alpha1, limit, gain=2.0):
    return RowSettings(alpha1, LinearClassK(gain), PERIOD, Box.symmetric(limit).radius)


def test_the_logarithm_requests_most_at_phi1_and_a_linear_function_the_more_the_faster():
    paper = LogClassK()
    assert braking.requested(RowSettings()) == pytest.approx(
        paper.phi1**2 * paper.phi2 / (paper.phi3 * np.e)
    )
    linear = RowSettings(LinearClassK(3.0))
    assert braking.requested(linear, fastest=0.8) == pytest.approx(3.0 * 0.8)


def test_half_the_logarithm_requests_a_quarter():
    half = RowSettings(LogClassK().scaled(0.5))
    assert braking.requested(half) == pytest.approx(0.25 * braking.requested(RowSettings()))


@pytest.mark.parametrize("gain", [0.5, 2.0, 20.0])
@pytest.mark.parametrize("limit", [0.5, 5.0])
def test_no_held_row_of_a_region_requests_more_than_that_where_psi_is_not_negative(limit, gain):
    settings = held(LogClassK(), limit, gain)
    rng = np.random.default_rng(0)
    n = 4000
    scenes = BarrierSet([[HalfPlane("wall", 1, (1.0, 0.0), 0.0)]] * n)
    x = np.zeros((n, 4))
    x[:, 0] = 3.0 * rng.random(n) ** 2
    x[:, 2] = -rng.random(n) * settings.alpha1.values(x[:, 0])  # ψ ≥ 0
    rows = planar_rows(scenes, x, np.zeros(n), settings)
    assert (rows.b <= braking.requested(settings) + 1e-9).all()
    on_edge = x.copy()
    on_edge[:, 2] = -settings.alpha1.values(x[:, 0])  # ψ = 0: the bound is not idle
    assert planar_rows(scenes, on_edge, np.zeros(n), settings).b.max() > 0.97 * braking.requested(
        settings
    )


@pytest.mark.parametrize(
    "input_set", [Box.symmetric(0.5), Ball(1.0), Box([-0.7, -9.0], [9.0, 9.0])]
)
def test_a_weak_u_can_brake_what_the_scaled_function_requests(input_set):
    settings = RowSettings(period=PERIOD, u_max=input_set.radius)
    factor = braking.share(settings, braking.weakest(input_set))
    scaled = RowSettings(LogClassK().scaled(factor), period=PERIOD, u_max=input_set.radius)
    assert 0.0 < factor < 1.0
    able = (1.0 - braking.RESERVE) * braking.weakest(input_set)
    assert braking.requested(scaled) == pytest.approx(able, rel=1e-6)


def test_a_brake_function_is_lowered_to_what_u_can_do_and_requests_no_more():
    c = braking.share(held(BrakeClassK(9.0, 0.2), 5.0), 5.0)
    lowered = BrakeClassK(9.0, 0.2).scaled(c)
    assert lowered.deceleration == pytest.approx(0.9 * 5.0, rel=2e-3)
    assert braking.share(held(BrakeClassK(4.5, 0.09), 5.0), 5.0) == 1.0
    settings = held(BrakeClassK(4.5, 0.09), 5.0, 25.0)
    h = np.geomspace(1e-5, 3.0, 4000)
    x = np.column_stack([h, 0.0 * h, -settings.alpha1.values(h), 0.0 * h])  # ψ = 0
    scenes = BarrierSet([[HalfPlane("wall", 1, (1.0, 0.0), 0.0)]] * len(h))
    assert planar_rows(scenes, x, np.zeros(len(h)), settings).b.max() <= 4.5


def test_a_strong_u_leaves_the_function_as_it_is():
    assert braking.share(held(LogClassK(), 5.0), 5.0) == 1.0


def test_straight_braking_stops_before_a_wedge_where_the_scene_is_not_warned_of():
    rng = np.random.default_rng(1)
    alpha1, able = LogClassK(), 2.0
    fastest = 2.0 * able / alpha1.derivative(0.0)
    for _ in range(300):
        angle, speed = rng.uniform(0.02, 1.5), fastest * rng.random()
        heading = rng.uniform(-angle, angle)
        v = speed * np.array([np.cos(heading), np.sin(heading)])
        normals = np.array([[-np.sin(angle), np.cos(angle)], [-np.sin(angle), -np.cos(angle)]])
        approach = np.maximum(-normals @ v, 0.0)
        h = np.array([alpha1.inverse(s) for s in approach])  # ψ = 0 for both
        stopped = h + normals @ v * speed / (2.0 * able)
        assert (stopped >= -1e-12).all()


def found(barriers, alpha1=None, limit=5.0, margin=0.0):
    alpha1 = LogClassK() if alpha1 is None else alpha1
    scenes = BarrierSet([barriers])
    return [s.what for s in shortcomings(scenes, alpha1, Box.symmetric(limit), margin)]


def test_what_a_scene_requests_beyond_u_and_its_speed_limit_is_found():
    cap, moving = SpeedLimit("cap", 1, 0.5), Disc("boat", 1, (3.0, 0.0), 1.0, (-0.3, 0.0))
    assert found([POND, cap]) == []
    assert found([moving, cap]) == []
    assert found([moving, cap], margin=0.18) == ["flight"]
    assert found([POND, SpeedLimit("cap", 1, 0.38)], margin=0.18) == ["slowness"]
    assert found([POND, Disc("lake", 1, (-3.0, 0.0), 1.0), SpeedLimit("cap", 1, 1.0)], limit=2.0)
    reed = Ellipse("reed", 1, semi_axes=(3.0, 0.2))
    assert found([reed, SpeedLimit("cap", 1, 1.0)], limit=2.0) == []
    assert found([POND, SpeedLimit("cap", 1, 1.0)], limit=2.1) == []
    assert found([POND], LinearClassK(2.0)) == ["speed"]
    assert found([POND, SpeedLimit("cap", 1, 1.0)], LinearClassK(4.0)) == []
    assert found([POND, SpeedLimit("cap", 1, 1.0)], LinearClassK(5.0)) == ["braking"]


@pytest.mark.parametrize("name", scenarios.names())
def test_no_scene_of_this_package_requests_too_much_but_lanes_faster_than_the_robot(name):
    what = set()
    for seed in range(20):
        scene = scenarios.make(name, np.random.default_rng(seed))
        cap = 1.5 if scene.v_max is None else scene.v_max
        what |= {*found([*scene.barriers, SpeedLimit("cap", 1, cap)], margin=0.18)}
    assert what == ({"flight"} if name == "random-crossing" else set())


def test_a_margin_that_leaves_nothing_of_a_speed_limit_is_refused():
    scenes = BarrierSet([[POND, SpeedLimit("cap", 1, 0.36)]])
    with pytest.raises(InvalidInputError, match=r"got 0\.36 m/s, expected above 0\.36"):
        check_limits(scenes, None, 7.0, 0.18)
    check_limits(scenes, None, 7.0, 0.17)


def weak_scene(limit):
    return {
        "name": "weak",
        "barriers": [
            {"kind": "disc", "name": "a", "priority": 1, "center": [1.5, 0.0], "radius": 0.7}
        ],
        "reference": {"kind": "point", "goal": [3.0, 0.0]},
        "task": "reach",
        "input_set": {"kind": "box", "low": [-limit] * 2, "high": [limit] * 2},
    }


@pytest.mark.parametrize("limit", [0.5, 0.7, 1.0, 2.0])
def test_a_weak_robot_is_kept_out_of_a_disc(limit):
    env = gym.make("HCBF-Regions-v0", scenario=weak_scene(limit))
    env = wrappers.SafetyFilter(env)
    _, info = env.reset(seed=0)
    for _ in range(400):
        _, _, _, _, info = env.step(np.array([5.0, 0.0]))
        assert info["min_h"][0] >= 0.0
        assert info["safety_filter"]["status"] <= 1
        assert 0.0 < info["safety_filter"]["alpha1_scale"] < 1.0
    assert info["h"][0] < 0.2  # it got near


def test_a_set_without_a_braking_input_is_refused():
    scene = weak_scene(1.0) | {"input_set": {"kind": "box", "low": [0.0, -1.0], "high": [1.0, 1.0]}}
    with pytest.raises(InvalidInputError, match="no braking input"):
        wrappers.SafetyFilter(gym.make("HCBF-Regions-v0", scenario=scene))
