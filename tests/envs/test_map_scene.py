import copy
import json
import pickle

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import Plant, _core, scenarios, wrappers
from hcbf_gym.barriers import BarrierSet, RowSettings, SpeedLimit
from hcbf_gym.errors import InvalidInputError, SafetyWarning
from hcbf_gym.evaluation import attacks
from hcbf_gym.models import DoubleIntegrator, Uncertainty
from hcbf_gym.programs import FilterStatus
from hcbf_robots.maps import MapClass
from tests.maps.floors import cells, on_map, room, true_distance
from tests.worlds import World

BODY = 0.1


def free(ranked, seed, clearance=BODY + 0.05):
    rng = np.random.default_rng(seed)
    points = ranked.grid.to_world(rng.uniform([0, 0], [80, 60], (2000, 2)))
    return points[ranked.distance(points, 1) > clearance]


@pytest.mark.parametrize("attack", attacks.ATTACKS)
def test_no_attack_enters_the_exact_squares_of_a_strict_class(attack):
    ranked = room(len(attack), (1.0, -2.0, 0.4))
    start = free(ranked, 0)[3]
    env = gym.make("HCBF-Regions-v0", scenario=on_map(ranked, start), max_episode_steps=150)
    env = wrappers.SafetyFilter(env, margin=BODY)
    _, info = env.reset(seed=1)
    assert info["h"].shape == info["safety_filter"]["margin"].shape == (2,)
    wants = attacks.make(attack, 1)
    places, least, truncated = [], np.inf, False
    while not truncated:
        _, _, terminated, truncated, info = env.step(wants.act(attacks.observe(env)))
        truncated = truncated or terminated
        assert info["safety_filter"]["status"] <= FilterStatus.RELAXED
        least = min(least, info["min_h"][0])
        places.append(env.unwrapped.rom_state[:2])
    assert least >= BODY
    assert true_distance(ranked, ranked.classes[0].cells, np.array(places)).min() >= BODY


def test_a_scene_with_a_map_travels_through_json_and_through_a_spec():
    ranked = room(0)
    made = scenarios.from_dict(on_map(ranked, free(ranked, 0)[0]))
    again = scenarios.from_dict(json.loads(json.dumps(made.to_dict())))
    assert again.to_dict() == made.to_dict()
    env = gym.make("HCBF-Regions-v0", scenario=made.to_dict())
    spec = type(env.spec).from_json(env.spec.to_json())
    assert spec.kwargs == env.spec.kwargs


def test_no_robot_enters_a_zone_faster_than_its_limit():
    strip = np.zeros((60, 80), dtype=np.bool_)
    strip[:, 40:55] = True
    ranked = room(0)
    walls = MapClass("walls", 1, "keepout", np.zeros_like(strip))
    zone = MapClass("zone", 1, "speed", strip, limit=0.4)
    ranked = type(ranked)(ranked.grid, (walls, zone))
    env = gym.make("HCBF-Regions-v0", scenario=on_map(ranked, (0.5, 1.5)), max_episode_steps=200)
    env = wrappers.SafetyFilter(env)
    env.reset(seed=0)
    fastest, outside = 0.0, 0.0
    for _ in range(200):
        _, _, _, _, info = env.step(np.array([5.0, 0.0]))
        x = env.unwrapped.rom_state
        inside = 2.0 <= x[0] <= 2.75
        speed = np.hypot(*x[2:])
        fastest = max(fastest, speed if inside else 0.0)
        outside = max(outside, 0.0 if inside else speed)
        assert info["min_h"][1] >= 0.0
    assert x[0] > 2.75
    assert 0.3 < fastest <= 0.4
    assert outside > 1.0


def plant(ranked, start, body=BODY):
    state = np.array([*start, 0.0, 0.0])
    return Plant(
        DoubleIntegrator(),
        [ranked, SpeedLimit("speed", 1, 1.5)],
        lambda env, observation, info: state,
        period=0.02,
        uncertainty=Uncertainty(body=body),
    )


def test_a_users_own_plant_takes_a_map_among_its_barriers_and_reports_a_start_too_near():
    ranked = room(0)
    points = free(ranked, 0, 0.0)
    distance = ranked.distance(points, 1)
    near, far = points[distance.argmin()], points[distance.argmax()]
    for start, status in ((near, FilterStatus.UNSAFE), (far, FilterStatus.NOMINAL)):
        env = wrappers.SafetyFilter(World(), plant=plant(ranked, start))
        _, info = env.reset()
        assert info["safety_filter"]["status"] == status
        assert info["safety_filter"]["slack"].shape == (2,)


def test_a_cell_that_appears_under_the_body_is_reported_at_once():
    ranked = room(0)
    start = free(ranked, 0)[0]
    barriers = [ranked]
    given = plant(ranked, start)
    env = wrappers.SafetyFilter(
        World(),
        plant=Plant(
            given.model, lambda *_: barriers, given.state, period=0.02,
            uncertainty=given.uncertainty,
        ),
    )  # fmt: skip
    env.reset()
    assert env.step(np.zeros(2))[-1]["safety_filter"]["status"] < FilterStatus.UNSAFE
    c, r = ranked.grid.to_cells([start])[0].astype(int)
    barriers = [ranked.update((int(r), int(c)), {"walls": np.ones((1, 1), dtype=np.bool_)})]
    assert env.step(np.zeros(2))[-1]["safety_filter"]["status"] == FilterStatus.UNSAFE


def test_a_new_zone_with_such_a_limit_is_not_accepted():
    ranked = room(0)
    start = free(ranked, 0)[0]
    barriers = [ranked]
    given = plant(ranked, start)
    read = Plant(given.model, lambda *_: barriers, given.state, period=0.02)
    env = wrappers.SafetyFilter(World(), plant=read)
    env.reset()
    zone = MapClass("zone", 1, "speed", np.ones_like(cells(0)), limit=0.05)
    barriers = [room(0, zone=zone)]
    with pytest.warns(SafetyWarning, match="barriers"):
        report = env.step(np.ones(2))[-1]["safety_filter"]
    assert report["status"] == FilterStatus.BACKUP
    with pytest.raises(InvalidInputError, match="speed zone"):
        env.reset()


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copied_scene_knows_its_own_pieces(copied):
    scenes = copied(BarrierSet([[room(0)]]))  # where the first one's lay others may lie soon
    begins = scenes.parameters.copy()
    scenes.set_scene(0, [scenes.atlas.held[0, 0]])
    assert (scenes.parameters == begins).all()


def nearby(scenes, settings, uncertainty, x):
    """Return the blocks of scene 0 at a state, maps replaced by their nearby pieces."""
    scene = scenes.kind[0], scenes.parameters[0], scenes.priority[0], scenes.own_margin[0]
    known = x, x, np.zeros(4), np.zeros((4, 4)), 0.0
    numbers = np.array(uncertainty, dtype=float), settings.packed, 7.1
    return _core.map_nearby(*numbers, *scene, scenes.atlas.numbers, *known)[1]


def test_what_lies_beyond_the_horizon_allows_every_input_for_a_period():
    ranked = room(1)
    settings = RowSettings(period=0.02, u_max=7.1)
    whole = BarrierSet([[ranked]])
    rng = np.random.default_rng(0)
    points = free(ranked, 3, 0.0)[:60]
    for point in points:
        velocity = rng.normal(size=2)
        x = np.array([*point, *velocity])
        hand = nearby(whole, settings, Uncertainty(body=BODY), x)
        taken = {tuple(block.round(12)) for block in hand}
        for angle in np.linspace(0.0, 2.0 * np.pi, 9):
            u = 7.1 * np.array([np.cos(angle), np.sin(angle)])
            later = np.array([*(point + 0.02 * velocity + 0.0002 * u), *(velocity + 0.02 * u)])
            all_of_it = nearby(whole, settings, Uncertainty(distance=50.0), x)
            rest = [b for b in all_of_it if tuple(b.round(12)) not in taken]
            if not rest:
                continue
            kind = np.full((1, len(rest)), 3)
            part = BarrierSet([()])
            part.kind, part.parameters = kind, np.array(rest)[None]
            part.own_margin = part.keeps_margin = np.zeros(kind.shape)
            part.priority = np.ones(kind.shape, dtype=np.int64)
            h, seen = part.sense(later[None], np.zeros(1))
            closing = (seen[0, :, 1:3] * later[2:]).sum(axis=1)
            assert (closing + settings.alpha1.values(h[0] - BODY) >= 0.0).all()
            assert (h >= BODY).all()
