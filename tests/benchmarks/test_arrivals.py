"""Guided robots arrive, in scenes where one did not."""

import pytest

from benchmarks import arrivals


@pytest.mark.physics
@pytest.mark.parametrize("seed", [96_028, 96_045])
def test_a_cart_whose_policy_pulls_back_from_its_way_arrives(seed):
    """It turned to its way and, as u* has it, from there again, to and fro in one place."""
    (run,) = arrivals.walk("cart", "random-map", range(seed, seed + 1))
    assert run.arrived
    assert not run.entered
    assert run.stand <= 0.5
