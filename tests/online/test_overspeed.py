"""A strict limit that comes while a robot is faster is said to be exceeded until it is not."""

import numpy as np
import pytest

from hcbf_gym.programs import FilterStatus
from hcbf_robots import Command, Response, Robot, VelocityFilter
from hcbf_robots.maps import Grid, MapClass, RankedMap
from tests.online.test_unmeasured import Lagged

LATE = Response(
    time_constant=0.3, delay=0.1, residual=(0.003, 0.01, 0.04), sway=0.01, overshoot=0.0,
    braking=0.97, stopping=0.3, seconds=60.0,
)  # fmt: skip
ROBOTS = {
    "cart": Robot(Command(0.8, 1.5, look_ahead=0.2), LATE, reach=0.2),
    "holonomic": Robot(Command(0.8, 1.5, sideways=0.8), LATE, reach=0.2),
}
LIMIT, PERIOD = 0.4, 0.1
CELLS = np.ones((200, 200), dtype=bool)
ZONE = RankedMap(
    Grid(0.1, (-10.0, -10.0, 0.0), CELLS.shape), (MapClass("slow", 1, "speed", CELLS, limit=LIMIT),)
)


def cap(safe):
    safe.v_max = LIMIT


def zone(safe):
    safe.barriers = [ZONE]


@pytest.mark.parametrize("turning", [0.0, 0.1, -0.8], ids=["straight", "turns", "turns fast"])
@pytest.mark.parametrize("anew", [False, True], ids=["goes on", "reset"])
@pytest.mark.parametrize("limits", [cap, zone])
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.filterwarnings("ignore:safety filter", "ignore:v_max")
def test_no_step_above_a_strict_limit_is_called_calm(name, limits, anew, turning):
    safe, robot = VelocityFilter(ROBOTS[name], [], period=PERIOD), ROBOTS[name]
    driven = Lagged((0.0, 0.0, 0.0), 0.3, 0.1)
    asked = np.zeros(len(robot.command.limits))
    asked[0], asked[-1], above, below = 0.8, turning, 0, 0
    for k in range(80):
        if k == 30:
            assert driven.velocity[0] > 0.7
            if anew:
                safe.reset()
            limits(safe)
        told, report = safe.step(asked, driven.pose, driven.velocity, PERIOD * k)
        if k >= 30 and np.hypot(*driven.velocity[:2]) > LIMIT + 1e-3:
            assert report["status"] == FilterStatus.UNSAFE, k
            above += 1
        elif k >= 30:
            below += report["status"] <= FilterStatus.SAFE
        list(driven.drive(told, PERIOD))
    assert above >= 3
    assert below >= 20  # it is slow enough in the end, and calm
