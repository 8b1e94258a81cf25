"""Where ψ is below zero but U can stop, the robot stops, whichever core and shape answers."""

import warnings
from dataclasses import dataclass

import numpy as np
import pytest

from hcbf_gym.barriers import HalfPlane, PlanarBarrier
from hcbf_gym.models import DoubleIntegrator
from tests.worlds import OwnDisc
from tests.wrappers.point_mass import AHEAD, filtered, quietly

WALL = HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-2.0)


@dataclass(frozen=True)
class OwnWall(PlanarBarrier):
    """A wall without a core."""

    name: str = "own wall"
    priority: int = 1

    def planar_jet(self, q):
        return 2.0 - q[0], np.array([-1.0, 0.0]), np.zeros((2, 2))


CORES = {
    "compiled": {},
    "daqp": {"solver": "daqp"},
    "another model": {"model": DoubleIntegrator(drag=0.1)},
}


@pytest.mark.parametrize("wall", [WALL, OwnWall()], ids=["shape", "own"])
@pytest.mark.parametrize("core", CORES)
def test_a_robot_that_can_still_stop_before_a_wall_does(core, wall):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = filtered(listed=(wall,), **CORES[core])
        env.reset(seed=0)
        env.unwrapped.x = np.array([1.6, 0.0, 1.9, 0.0])  # .361 m of .4 m stop it
        quietly(env, np.zeros(2))  # this state is news
    least = min((quietly(env, AHEAD), 2.0 - env.unwrapped.x[0])[1] for _ in range(150))
    assert least >= -1e-6


def test_a_condition_without_a_core_keeps_what_h_dips_between_two_samples():
    env = filtered(listed=(OwnDisc("own disc", 1, (2.0, 0.0)),), period=0.02)
    env.reset(seed=0)
    env.unwrapped.x = np.zeros(4)
    least = np.inf
    for _ in range(300):
        before = env.unwrapped.x.copy()
        report = quietly(env, AHEAD)
        u = report["u_safe"]
        for part in np.linspace(0.0, 0.02, 11):
            at = before[:2] + part * before[2:] + 0.5 * part**2 * u
            least = min(least, float(np.hypot(at[0] - 2.0, at[1]) - 0.5))
    assert 0.0 <= least < 0.05
    assert report["margin"][0] >= 0.499 * np.hypot(5.0, 5.0) * 0.02**2
