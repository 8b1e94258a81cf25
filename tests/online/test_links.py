"""A robot in MuJoCo under hostile commands, behind odometry that is late, rare, or lost."""

import numpy as np
import pytest

from benchmarks.own_loop import LONGEST, Link, Moving, Rig, boxes_of, hostile, loop
from hcbf_robots import VelocityFilter
from hcbf_robots.walkers import Walker

LINKS = {
    "perfect": Link(),
    "60 ms late": Link(50.0, 0.06, 0.2),
    "190 ms late": Link(50.0, 0.19, 0.05),
    "10 Hz, 100 ms late, 10 % lost": Link(10.0, 0.1, 0.2, 0.1),
    "20 Hz, 60 ms late, 30 % lost": Link(20.0, 0.06, 0.3, 0.3),
    "20 Hz, bursts of 4, 30 % lost": Link(20.0, 0.02, 0.3, 0.3, 4),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", LINKS)
def test_a_hostile_planner_behind_bad_odometry_does_not_enter(name):
    cart = Walker.load("cart")
    for seed in range(2):
        rng = np.random.default_rng([3, seed])
        boxes = boxes_of(rng)
        safe = VelocityFilter(cart, boxes, period=LONGEST, max_age=0.4)
        planner, rig = hostile(boxes, cart.command, rng), Rig(cart.reach, LINKS[name])
        run = loop(safe, Moving(cart, np.zeros(3), seed), planner, 20.0, seed, rig)
        assert run.least >= 0.0
        assert not run.fell
        assert np.linalg.norm(np.diff(run.path[:, :2], axis=0), axis=1).sum() > 2.0
