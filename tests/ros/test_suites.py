"""What the node must show, in its short forms."""

import pytest

from benchmarks.ros import suites, wedge

pytestmark = [
    pytest.mark.physics,
    pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning"),
]


@pytest.mark.parametrize("part", ["foreign", "gaps", "errands"])
def test_the_short_form_of_each_part_has_no_miss(part):
    lines = list(suites.PARTS[part](True))
    assert lines
    assert [line for line in lines if "MISS" in line] == []


def test_robots_leave_zones_and_arrive():
    """How long a cart may stand before a zone that it has left is open, see docs/ros.md."""
    lines = [line for line in suites.PARTS["wedge"](True) if "out in time" in line]
    assert len(lines) == 14
    for line in lines:
        assert "2 of 2 out in time, 2 led" in line
        assert "2 arrived" in line


@pytest.mark.parametrize(
    ("kind", "rank", "seed"), [("between obstacles", 1, 19), ("a zone appears", 2, 19)]
)
def test_a_guided_cart_turns_to_its_way_though_its_planner_turns_it_from_there(kind, rank, seed):
    """Backing to a way behind it, it turned from it; parallel to an edge it stood for ever."""
    way = wedge.drive(wedge.scene(kind, "cart", rank, seed))
    assert way.led
    assert way.arrived
    assert way.out <= way.allowed
    assert way.still < 2.0
