"""What appears too near is reported: VIOLATED while rows prove nothing, until they do again."""

import warnings

import numpy as np
import pytest

from hcbf_gym import Estimate
from hcbf_gym.barriers import Disc, HalfPlane
from hcbf_gym.errors import SafetyWarning
from hcbf_gym.programs import FilterStatus
from hcbf_robots import VelocityFilter
from hcbf_robots.maps import Grid, MapClass, RankedMap

# the robot here follows at once, and the cart's response does not
pytestmark = pytest.mark.filterwarnings("ignore:safety filter. the robot does not do")
FREE = np.zeros((80, 120), dtype=np.bool_)


def floor(**boxes):
    """Return a map of 12 x 8 m with boxes of cells: name -> rows and columns."""
    cells = FREE.copy()
    for low_r, high_r, low_c, high_c in boxes.values():
        cells[low_r:high_r, low_c:high_c] = True
    return RankedMap(Grid(0.1, (0.0, 0.0, 0.0), FREE.shape), (MapClass("w", 1, "keepout", cells),))


def drive(safe, before, after, steps=60, speed=1.0, change=20):
    """Drive ahead from (2, 4) as commanded; return the statuses, and where the robot was."""
    x, v, found, places = 2.0, 0.0, [], []
    for k in range(steps):
        safe.barriers = before if k < change else after
        (v, *_), report = safe.step((speed, 0.0, 0.0), (x, 4.0, 0.0), (v, 0.0, 0.0), 0.05 * k)
        x += 0.05 * v
        found.append(FilterStatus(int(report["status"])))
        places.append(x)
    return found, places


@pytest.mark.parametrize("ahead", [0.22, 0.3, 0.4])
def test_a_cell_that_appears_too_near_is_reported_until_the_rows_prove_something_again(ahead):
    safe = VelocityFilter("holonomic-cart", [floor()], radius=0.2)
    _, places = drive(safe, [floor()], [floor()], steps=21, speed=0.8)
    at = int((places[20] + ahead) / 0.1)
    wall = [floor(wall=(20, 60, at, at + 3))]
    safe.reset()
    found, places = drive(safe, [floor()], wall, steps=400, speed=0.8)
    assert max(found[:20]) < FilterStatus.VIOLATED
    assert found[20] >= FilterStatus.VIOLATED
    assert max(found[-50:]) < FilterStatus.VIOLATED
    entered = [k for k, x in enumerate(places) if x + 0.2 > at * 0.1]
    assert all(found[min(k + 1, len(found) - 1)] >= FilterStatus.VIOLATED for k in entered)


def test_what_appears_far_enough_changes_nothing():
    safe = VelocityFilter("holonomic-cart", [floor()], radius=0.2)
    found, _ = drive(safe, [floor()], [floor(wall=(20, 60, 90, 93))])
    assert max(found) < FilterStatus.VIOLATED


def test_a_start_within_the_margin_is_reported():
    near = Disc("pillar", 1, (2.0, 0.0), 0.5)
    safe = VelocityFilter("holonomic-cart", [near], radius=0.3)
    _, report = safe.step((0.0, 0.0, 0.0), (1.19, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)
    assert report["status"] == FilterStatus.VIOLATED
    safe.reset()
    _, report = safe.step((0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)
    assert report["status"] < FilterStatus.VIOLATED


def wall(at, mapped):
    """Return a wall ahead, of new objects each time, as a region or as a map."""
    if mapped:
        return [floor(wall=(20, 60, round(10 * at), round(10 * at) + 3))]
    return [HalfPlane("wall", 1, (-1.0, 0.0), -at)]


@pytest.mark.parametrize("mapped", [False, True])
def test_the_same_wall_passed_anew_is_no_change_to_a_robot_that_creeps(mapped):
    safe = VelocityFilter("holonomic-cart", wall(6.0, mapped), radius=0.2)
    still, speed = np.zeros(3), 0.02
    for k in range(60):  # though it is commanded zero
        safe.barriers = wall(6.0, mapped)
        x = 6.0 - max(0.2733 - 0.05 * speed * k, 0.2163)
        _, report = safe.step(still, (x, 4.0, 0.0), (speed, 0.0, 0.0), 0.05 * k)
        assert report["status"] < FilterStatus.VIOLATED
    assert report["h"][0] < report["margin"][0] - 0.05
    assert not report["proved"]
    safe.barriers = wall(5.8, mapped)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SafetyWarning)  # of a wall that moves
        _, report = safe.step(still, (x - 0.12, 4.0, 0.0), still, 0.05 * 60)
    assert report["status"] >= FilterStatus.VIOLATED


def test_barriers_set_twice_between_two_steps_are_compared_with_those_of_a_step():
    safe = VelocityFilter("holonomic-cart", wall(6.0, False), radius=0.2)
    still, core = np.zeros(3), safe._core
    for k in range(10):
        safe.step(still, (5.5, 4.0, 0.0), still, 0.05 * k)
    kept = []
    for at in (5.77, 5.765):  # far enough to be met by 5 mm, and then too near by as much
        scene = [*wall(at, False), *safe._input.scene()[1:]]
        core.scenes.take(scene, Estimate(np.zeros(4), time=0.0), None, counts=True)
        kept.append(float(core.samples.plants["kept"][0]))
    assert kept[0] == pytest.approx(0.5 - 0.2 - core.config.uncertainty.distance, abs=0.01)
    assert kept[1] == kept[0]
