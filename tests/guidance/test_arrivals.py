"""Guided robots arrive, in scenes where one did not."""

import pytest

from hcbf_gym.evaluation.attacked import AttackedEpisode


@pytest.mark.physics
@pytest.mark.parametrize(("seed", "seconds"), [(96_028, 28.0), (96_045, 24.0)])
def test_a_cart_whose_policy_turns_it_back_from_its_path_arrives(seed, seconds):
    """It turned to its path and, as u* has it, from there again, to and fro in one place."""
    seen = AttackedEpisode(
        "pd", "random-map", seed, "hcbf_robots:HCBF-WalkerRegions-v0", {"robot": "cart"},
        {"guidance": "geodesic"},
    ).run()  # fmt: skip
    assert seen.reached
    assert min(seen.least_h, seen.least_speed_h) >= 0.0
    assert seen.seconds <= seconds
