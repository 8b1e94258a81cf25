"""Faults of unmeasured robots on wheels are reported and stop them; robots without one never."""

import pytest

from benchmarks.unmeasured import FAULTS, FLEET, WITHIN, cases, honest

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", ["TurtleBot 4", "omni"])
def test_a_fault_is_reported_within_2_s_of_driving_and_stops_the_robot(name, fault):
    for one in cases(name, fault, 4):
        assert one.after <= WITHIN
        assert one.stops


def test_no_robot_without_a_fault_is_reported():
    assert honest(len(FLEET), 20.0) == []
