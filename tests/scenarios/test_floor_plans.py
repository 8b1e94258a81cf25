"""Floor plans: what ships is what the script draws, and every way through a map can be gone."""

import importlib.util
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from hcbf_gym import policies, scenarios, wrappers
from hcbf_gym.errors import InvalidInputError
from hcbf_robots.maps import Grid, MapClass, RankedMap, floor_plans
from hcbf_robots.maps.floor_plans import APART, CLEAR, FOLDER, NAMES


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
    paths = family.drawn([np.random.default_rng(seed) for seed in range(50)])
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


def test_a_map_without_room_is_refused():
    full = MapClass("occupied", 1, "keepout", np.ones((20, 20), dtype=np.bool_))
    with pytest.raises(InvalidInputError, match="room for start and goal"):
        floor_plans.places(RankedMap(Grid(0.05, (0.0, 0.0, 0.0), (20, 20)), (full,)))
