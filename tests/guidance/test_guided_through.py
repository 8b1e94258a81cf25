"""Guidance through ranks that are relaxed, and robots that arrive where one did not."""

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym.barriers import Disc, HalfPlane
from hcbf_gym.evaluation.attacked import AttackedEpisode
from hcbf_gym.guidance import Geodesic
from hcbf_gym.policies import PDTracker
from hcbf_gym.scenarios import Scenario
from hcbf_gym.scenarios.references import PointReference
from hcbf_gym.wrappers import SafetyFilter
from hcbf_robots.maps import Grid, MapClass, RankedMap

THROUGH = {"kind": "geodesic", "through": 2}


def drive(scenario, steps):
    """Let PD drive under the filter; return the last position (2,) and the least strict h."""
    made = gym.make("HCBF-Regions-v0", scenario=scenario, max_episode_steps=steps)
    env = SafetyFilter(made, guidance=THROUGH)
    act = PDTracker.for_env(env)
    observation, info = env.reset(seed=0)
    strict = np.array([one.priority == 1 for one in made.unwrapped.barriers])
    least, over = np.inf, False
    while not over:
        observation, _, terminated, truncated, info = env.step(act(observation, info))
        least = min(least, info["min_h"][strict].min())
        over = terminated or truncated
    return env.unwrapped.rom_state[:2], least


def test_between_a_wall_and_a_region_that_is_relaxed_the_robot_continues():
    place, least = drive("paper-experiment-straight", 1000)
    np.testing.assert_allclose(place, (-4.0, 3.34), atol=0.1)
    assert least >= 0.0


@pytest.mark.parametrize("deep", [2, 25])
def test_a_zone_that_closes_a_corridor_is_crossed(deep):
    walls = np.zeros((60, 160), dtype=np.bool_)  # 8 x 3 m
    walls[:20, 40:120] = walls[40:, 40:120] = True
    zone = np.zeros_like(walls)
    zone[20:40, 70 : 70 + deep] = True
    floor = RankedMap(
        Grid(0.05, (0.0, 0.0, 0.0), walls.shape),
        (MapClass("walls", 1, "keepout", walls), MapClass("mats", 2, "keepout", zone)),
    )
    goal = PointReference((7.0, 1.5))
    scene = Scenario("corridor", (), goal, start=(1.0, 1.0), task="reach", v_max=1.0, map=floor)
    place, least = drive(scene, 1000)
    assert np.linalg.norm(place - (7.0, 1.5)) < 0.5
    assert least >= 0.0


def test_from_within_a_strict_clearance_the_way_leads_out_by_the_shortest():
    # the only way crosses rank 2, at a thousand a metre
    wall = HalfPlane("wall", 1, normal=(0.0, 1.0), offset=0.0)
    other = HalfPlane("other", 1, normal=(0.0, -1.0), offset=-1.0)
    relaxed = Disc("relaxed", 2, center=(0.0, 0.5), radius=0.8)
    way = Geodesic(through=2)
    way.reset([wall, other, relaxed], (3.0, 0.5), clearance=0.3, start=(-3.0, 0.5))
    for x in (-2.0, -1.2, -0.5, 0.0, 0.5):
        state = np.array([[x, 0.05, 0.0, 0.0]])
        (a,), _ = way.rows(state, np.zeros(1))
        assert a[1] > 0.6  # to the point .6 m further, of which the first .25 m lead out
        assert way.reachable(state) == 2


@pytest.mark.physics
@pytest.mark.parametrize(("seed", "seconds"), [(96_028, 28.0), (96_045, 24.0)])
def test_a_cart_whose_policy_turns_it_back_from_its_path_arrives(seed, seconds):
    """It turned to its path and, as u* has it, from there again, to and fro in one place."""
    seen = AttackedEpisode(
        "pd", "random-map", seed, "hcbf_robots:HCBF-WalkerRegions-v0", {"robot": "cart"},
        {"guidance": "geodesic"},
    ).run()  # fmt: skip
    assert seen.reached
    assert min(seen.least_h, seen.least_speed_h) >= 0.0
    assert seen.seconds <= seconds
