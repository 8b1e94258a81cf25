"""What the node must show, in its short forms."""

import pytest

from benchmarks.ros import suites, wedge

pytestmark = [
    pytest.mark.physics,
    pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning"),
]


@pytest.mark.parametrize("part", ["foreign", "gaps", "errands", "wedge"])
def test_the_short_form_of_each_part_has_no_miss(part):
    lines = list(suites.PARTS[part](True))
    assert lines
    assert [line for line in lines if "MISS" in line] == []


@pytest.mark.parametrize(
    ("kind", "rank", "seed"),
    [
        ("between obstacles", 1, 3),
        ("between obstacles", 1, 19),
        ("a zone appears", 2, 10),
        ("a zone appears", 2, 19),
        ("a zone appears", 3, 14),
    ],
)
def test_a_guided_cart_turns_to_its_way_though_its_planner_turns_it_from_there(kind, rank, seed):
    """Backing to a way behind it, it turned from it; parallel to an edge it stood for ever; backing
    from one, its turn was given away, to and fro, for a hair of speed."""
    way = wedge.drive(wedge.scene(kind, "cart", rank, seed))
    assert way.led
    assert way.arrived
    assert way.out <= way.allowed
    assert way.still <= wedge.LONGEST_STILL
