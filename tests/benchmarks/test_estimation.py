import numpy as np
import pytest

from benchmarks.suites import estimation


def walks(scale, n=50, steps=200):
    rng = np.random.default_rng(0)
    nees = scale * rng.chisquare(4, (n, steps))
    return [estimation.Walk(np.full(steps, 4e-4), np.full(steps, 9e-4), row, False) for row in nees]


def test_honest_covariances_lie_in_the_band_and_others_do_not():
    assert estimation._row("honest", walks(1.0))["share_inside"] == pytest.approx(0.95, abs=0.04)
    assert estimation._row("overconfident", walks(2.0))["share_inside"] < 0.05
    assert estimation._row("cautious", walks(0.5))["share_inside"] < 0.05


def test_an_episode_with_a_fall_counts_as_a_fall_alone():
    upright = walks(1.0, n=3)
    fallen = estimation.Walk(np.full(7, 100.0), np.full(7, 100.0), np.full(7, 100.0), True)
    row = estimation._row("mixed", [*upright, fallen])
    assert (row["fell"], row["episodes"]) == (1, 4)
    assert row["position_rms"] == pytest.approx(0.02)
    table = estimation.tables({"rows": [row]})["all"]
    assert len(table.rows[0]) == len(table.header)
    assert table.rows[0][1] == "2.00 cm"


@pytest.mark.physics
def test_a_walk_reports_every_step():
    (walk,) = estimation.walk({"drift": 0.01}, [0], steps=20)
    assert len(walk.position) == len(walk.velocity) == len(walk.nees) == 20
    assert not walk.fell
    assert (walk.nees > 0.0).all()
