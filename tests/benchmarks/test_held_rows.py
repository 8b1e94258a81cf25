"""The study of held rows, on a few scenes: no policy enters, and PD arrives as before."""

import pytest

from benchmarks.suites import held_rows


@pytest.mark.parametrize("policy", held_rows.POLICIES)
def test_no_policy_gets_past_a_strict_barrier(policy):
    result = held_rows.walk_all("random-moving", policy, "held", 10)
    assert result["entered"] == 0
    assert result["violated"] == 0
    assert result["gap"] < 1e-12  # what is followed here is what the environment did
    assert result["least_speed_h"] >= 0.0
    assert set(held_rows.tables({"held_rows": [result]})) == {"held-rows"}


def test_the_usual_rows_let_pd_pass_the_speed_limit_between_samples():
    assert held_rows.walk_all("random", "pd", "usual", 10)["least_speed_h"] < 0.0
