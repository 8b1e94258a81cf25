"""Suites of the node in their short forms."""

import pytest

from benchmarks.ros import suites, wedge

pytestmark = [
    pytest.mark.physics,
    pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning"),
]


@pytest.mark.parametrize("part", ["foreign", "errands", "wedge"])
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
    """Each was at rest for ever once: backing to a path behind it, parallel to an edge, backing."""
    found = wedge.drive(wedge.scene(kind, "cart", rank, seed))
    assert found.led
    assert found.arrived
    assert found.out <= found.allowed
    assert found.still <= wedge.LONGEST_STILL
