"""Hostile policies with estimates that are off: no strict region is entered under a calm status."""

import pytest

from benchmarks import uncertain

pytest.importorskip("jax")  # of an own model
CASES = uncertain.cases()


@pytest.mark.parametrize("error", uncertain.ERRORS)
@pytest.mark.parametrize("name", CASES)
@pytest.mark.filterwarnings("ignore")
def test_no_region_is_entered_under_a_calm_status(name, error):
    count = uncertain.run(CASES[name], error, steps=2000, seed=0)
    assert count.entered == 0
    assert count.calm > 0.6 * count.steps
    assert count.least < 1.0  # the policy does drive at the regions
