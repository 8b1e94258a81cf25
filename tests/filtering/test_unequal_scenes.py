"""A plant in a batch is filtered as alone, however long the scenes of the others are."""

import numpy as np
import pytest
import unequal

import hcbf_gym
from hcbf_gym.barriers import Disc, HalfPlane
from hcbf_gym.models.input_sets import Box
from hcbf_gym.programs import FilterStatus


@pytest.mark.parametrize("robot", unequal.ROBOTS)
@pytest.mark.filterwarnings("ignore")
def test_a_batch_of_unequal_scenes_is_as_many_single_filters(robot):
    place = list(unequal.ROBOTS).index(robot)
    total = 0
    for turn in range(len(unequal.PROGRAMS)):
        guidance = unequal.ROBOTS[robot][4]
        led = guidance[turn % len(guidance)]
        total += unequal.compare_batch(
            100 * place + turn, robot, unequal.PROGRAMS[turn], led
        ).total()
    assert total >= 4 * unequal.PLANTS * unequal.STEPS


def test_a_fast_robot_is_not_braked_by_filled_places():
    x = np.zeros((2, 4))
    x[1, 2] = 11.0
    filt = hcbf_gym.BatchFilter(Box.symmetric(5.0), 0.02, 2)
    filt.set_scene([[Disc("disc", 1, (3.0, 0.0), 0.5), HalfPlane("wall", 2, (0.0, 1.0), -3.0)], []])
    filt.reset(x=x)
    u, report = filt(np.array([[0.0, 0.0], [5.0, 0.0]]), x)
    np.testing.assert_array_equal(u[1], [5.0, 0.0])
    assert report["status"][1] == FilterStatus.NOMINAL
    np.testing.assert_array_equal(report["h"][1], np.inf)
    np.testing.assert_array_equal(report["margin"][1], 0.0)
    assert [tuple(one) for one in filt.conditions(1)] == [("nothing", 0)] * 2


@pytest.mark.filterwarnings("ignore")
def test_a_region_that_is_gone_moves_no_longer_whatever_the_other_plants_see():
    program = unequal.PROGRAMS[37 // len(unequal.ROBOTS) % len(unequal.PROGRAMS)]
    assert unequal.compare_batch(37, "uncertain", program, "local").total() > 0


@pytest.mark.filterwarnings("ignore")
def test_a_plant_that_was_too_fast_is_unsafe_no_longer_than_its_speed_lasts():
    program = unequal.PROGRAMS[363 // len(unequal.ROBOTS) % len(unequal.PROGRAMS)]
    assert unequal.compare_batch(363, "drag", program, None).total() > 0
