"""What the node must show, in its short forms."""

import pytest

from benchmarks.ros import suites

pytestmark = [
    pytest.mark.physics,
    pytest.mark.filterwarnings("ignore::hcbf_gym.errors.SafetyWarning"),
]


@pytest.mark.parametrize("part", [name for name in suites.PARTS if name not in ("faults", "bent")])
def test_the_short_form_of_each_part_has_no_miss(part):
    lines = list(suites.PARTS[part](True))
    assert lines
    assert [line for line in lines if "MISS" in line] == []
