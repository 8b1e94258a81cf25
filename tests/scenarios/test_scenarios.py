"""Scenes: names, files, references, and what is refused."""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy import ndimage

from hcbf_gym import HcbfError, policies, scenarios, wrappers
from hcbf_gym.barriers import Disc
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.scenarios.references import BezierReference
from hcbf_robots.maps import Grid, MapClass, RankedMap, floor_plans
from hcbf_robots.maps.floor_plans import APART, CLEAR, FOLDER, NAMES

LINE = {"kind": "bezier", "points": [[0.0, 0.0], [1.0, 0.0]]}
FIXED = [name for name in scenarios.names() if not scenarios.is_random(name)]


@pytest.mark.parametrize("name", FIXED)
def test_a_scene_survives_dict_and_json_file(name, tmp_path):
    scenario = scenarios.make(name)
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scenario.to_dict()), encoding="utf-8")
    assert scenarios.make(scenario.to_dict()).to_dict() == scenario.to_dict()
    assert scenarios.make(path).to_dict() == scenario.to_dict()
    assert scenarios.make(str(path)).barriers == scenario.barriers


def test_the_papers_scene_is_the_papers():
    scenario = scenarios.make("paper-simulation")
    x = np.array([-12.0, 10.0, 0.0, 0.0])
    expected = [12.2, 10.2, np.hypot(11, 4.5) - 4, np.hypot(11, 5.5) - 5]
    np.testing.assert_allclose([b.h(x) for b in scenario.barriers], expected)
    assert [b.priority for b in scenario.barriers] == [1, 1, 1, 2]
    np.testing.assert_allclose(scenario.goal, x[:2])
    printed = scenarios.make("paper-simulation-as-printed")
    assert printed.barriers[0].h(x) == pytest.approx(-11.8)
    four = scenarios.make("paper-four-levels")
    assert [b.priority for b in four.barriers] == [1, 2, 3, 4]


def test_the_experiments_boxes_stand_inside_region_1_and_clear_of_each_other():
    scenario = scenarios.make("paper-experiment")
    region1 = scenario.barriers[2]
    light, *heavy = scenario.obstacles
    assert light.mass is not None
    assert all(box.mass is None for box in heavy)
    for box in scenario.obstacles:
        assert region1.h(np.array([*box.center, 0, 0])) < -0.3
    for i, box in enumerate(scenario.obstacles):
        for other in scenario.obstacles[i + 1 :]:
            assert np.linalg.norm(np.subtract(box.center, other.center)) > 0.5


@given(st.floats(0.5, 30.0), st.floats(0.01, 0.5), st.floats(-1, 31))
def test_a_reference_has_consistent_derivatives_and_ends_at_its_goal(duration, share, t):
    reference = BezierReference(
        ((0.0, 0.0), (0.0, 2.5), (-0.2, 4.0), (-4.0, 3.34)), duration, ramp=share * duration
    )
    start, still = reference(0.0)
    goal, rest = reference(duration)
    np.testing.assert_allclose(start, 0.0, atol=1e-12)
    np.testing.assert_allclose(goal, [-4.0, 3.34], atol=1e-12)
    np.testing.assert_allclose([still, rest], 0.0, atol=1e-12)
    eps = 1e-4 * duration
    kinks = np.array([0.0, reference.ramp, duration - reference.ramp, duration])
    if np.abs(t - kinks).min() < 2 * eps:
        return
    (before, v_before), (after, v_after) = reference(t - eps), reference(t + eps)
    speed = 5.5 / (duration - reference.ramp)
    np.testing.assert_allclose((after - before) / (2 * eps), reference(t)[1], atol=2e-3 * speed)
    np.testing.assert_allclose(
        (v_after - v_before) / (2 * eps),
        reference.acceleration(t),
        atol=5e-3 * max(speed**2, speed / reference.ramp),
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"barriers": []}, "barriers"),
        ({"extra": 1}, "unknown field"),
        ({"name": None, "reference": None}, "reference"),
        ({"task": "fly"}, "track"),
        ({"goal_radius": -1.0}, "goal_radius"),
        ({"start": [0.0]}, "start"),
        ({"start": "here"}, "start"),
        ({"barriers": [{"kind": "disc", "name": "d", "priority": 1, "radius": -2}]}, "radius"),
        ({"barriers": [{"kind": "disc", "name": "d", "priority": 2}]}, "priorities"),
        ({"barriers": [{"kind": "blob", "name": "d", "priority": 1}]}, "half-plane"),
        ({"barriers": [{"kind": "disc", "priority": 1}]}, "missing"),
        ({"barriers": "none"}, "list"),
        ({"input_set": {"kind": "box", "low": [1, 1], "high": [2, 2]}}, "braking"),
        ({"obstacles": [{"name": "b", "center": [0, 0], "size": [1, 1, 0]}]}, "size"),
        ({"obstacles": [{"name": "", "center": [0, 0], "size": [1, 1, 1]}]}, "obstacle name"),
        ({"obstacles": 2 * [{"name": "b", "center": [0, 0], "size": [1, 1, 1]}]}, "different"),
        ({"start": [1e300, 1e300]}, "start"),
        ({"start": [10**400, 0]}, "start"),
        ({"reference": LINE | {"duration": 1e9}}, "duration"),
        ({"reference": {"kind": "point", "goal": [1e300, 0]}}, "goal"),
    ],
)
def test_a_bad_scene_is_refused_with_what_was_expected(change, message):
    data = scenarios.make("paper-simulation").to_dict() | change
    with pytest.raises(HcbfError, match=message):
        scenarios.make(data)


def test_unknown_names_and_unreadable_files_list_the_choices(tmp_path):
    with pytest.raises(UnknownNameError, match="paper-simulation"):
        scenarios.make("paper")
    broken = tmp_path / "broken.json"
    broken.write_text("{", encoding="utf-8")
    with pytest.raises(HcbfError, match="JSON"):
        scenarios.make(broken)
    with pytest.raises(HcbfError, match="JSON"):
        scenarios.make(tmp_path / "missing.json")
    with pytest.raises(HcbfError, match="missing"):
        scenarios.make({"name": "x"})
    with pytest.raises(HcbfError, match="expected"):
        scenarios.make(7)  # type: ignore[arg-type]
    scenario = scenarios.make("paper-simulation")
    with pytest.raises(HcbfError, match="different"):
        replace(scenario, barriers=(Disc("a", 1), Disc("a", 1)))


def script():
    """Return the script as a module: it is no part of the package."""
    path = Path(__file__).parents[2] / "scripts" / "floor_plans.py"
    spec = importlib.util.spec_from_file_location("floor_plans_script", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_plans_are_what_the_script_draws(tmp_path):
    script().main(tmp_path)
    assert {f.name for f in tmp_path.iterdir()} == {f.name for f in FOLDER.iterdir()}
    for drawn in tmp_path.iterdir():
        shipped = FOLDER / drawn.name
        if drawn.suffix == ".png":
            assert np.array_equal(np.array(Image.open(drawn)), np.array(Image.open(shipped)))
        else:
            assert drawn.read_text() == shipped.read_text()


@pytest.mark.parametrize("plan", NAMES)
def test_start_and_goal_leave_room_and_a_body_gets_from_one_to_the_other(plan):
    floor = floor_plans.load(plan)
    family = scenarios.family_of(f"map-{plan}")
    paths = family.draw_scenes([np.random.default_rng(seed) for seed in range(50)])
    ends = np.stack([paths.start, paths.goal], axis=1)
    assert floor.distance(ends.reshape(-1, 2)).min() > CLEAR - 0.05
    assert (np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) >= APART).all()
    side = floor.grid.resolution
    middles = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in floor.grid.shape[::-1])), axis=-1)
    away = floor.distance(floor.grid.to_world(middles.reshape(-1, 2)))
    joined, _ = ndimage.label(away.reshape(floor.grid.shape) > CLEAR - 2.0 * side)
    column, row = np.floor(floor.grid.to_cells(ends.reshape(-1, 2))).astype(int).T
    assert len(set(joined[row, column].tolist())) == 1


def test_a_seed_decides_the_way_and_another_one_another():
    first, again, other = (scenarios.make("map-flat", np.random.default_rng(s)) for s in (3, 3, 4))
    assert first.to_dict() == again.to_dict()
    assert first.map is other.map
    assert first.start != other.start
    assert scenarios.from_dict(first.to_dict()).to_dict() == first.to_dict()


@pytest.mark.parametrize("plan", NAMES)
def test_guided_pd_crosses_the_plan_and_enters_nothing_strict(plan):
    env = gym.make("HCBF-Regions-v0", scenario=f"map-{plan}", max_episode_steps=3000)
    env = wrappers.SafetyFilter(env, guidance="geodesic")
    observation, info = env.reset(seed=1)
    policy, least, over = policies.PDTracker.for_env(env), np.inf, False
    strict = [c.priority == 1 for c in env.unwrapped.scenario.conditions]
    while not over:
        observation, _, reached, late, info = env.step(policy(observation, info))
        least, over = min(least, info["min_h"][: len(strict)][strict].min()), reached or late
    assert info["is_success"]
    assert least >= 0.0


def test_a_map_alone_means_random_paths_through_it():
    source = {"map": {"file": str(FOLDER / "flat.yaml"), "masks": {"flat_keepout.yaml": 2}}}
    assert scenarios.is_random(source)
    env = gym.make("HCBF-Regions-v0", scenario=source).unwrapped
    starts = set()
    for seed in (0, 1, 2):
        env.reset(seed=seed)
        starts.add(env.scenario.start)
    assert env.scenario.name == "flat"
    assert len(starts) == 3


def test_the_path_of_a_scene_files_map_may_have_a_variable(tmp_path, monkeypatch):
    monkeypatch.setenv("PLANS", str(FOLDER))
    scene = scenarios.make("map-flat").to_dict() | {"map": {"file": "$PLANS/flat.yaml"}}
    (tmp_path / "scene.json").write_text(json.dumps(scene), encoding="utf-8")
    assert scenarios.load(tmp_path / "scene.json").map is not None


def test_a_map_without_room_is_refused():
    full = MapClass("occupied", 1, "keepout", np.ones((20, 20), dtype=np.bool_))
    with pytest.raises(InvalidInputError, match="room for start and goal"):
        floor_plans.places(RankedMap(Grid(0.05, (0.0, 0.0, 0.0), (20, 20)), (full,)))
