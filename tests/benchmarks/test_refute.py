"""The quick search for counterexamples to what the pages say."""

import pytest

from benchmarks import refute


@pytest.mark.parametrize("name", refute.CLAIMS)
def test_what_the_pages_say_is_not_refuted(name):
    looked, worst, _ = refute.search(name, 6, 80, 4)
    assert looked >= 50
    assert worst < -refute.ROUNDING if name in refute.CORRECTED else worst >= -refute.ROUNDING
