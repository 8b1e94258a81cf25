"""The paper's course, walked whole: few and long, so that they stay few."""

import numpy as np
import pytest

from hcbf_gym.evaluation.rollouts import Case
from hcbf_gym.programs import FilterStatus

A1, ROM = "HCBF-A1Regions-v0", "HCBF-Regions-v0"
R_OPTIONS, H_OPTIONS = {"gamma0": 0.05}, {"gamma0": 5.0, "delta_gamma": 1.3}


@pytest.fixture(scope="module")
def filtered():
    return {
        program: Case(A1, "paper-simulation", "pd", program, options).run(seed=0)
        for program, options in (("r-cbf-qp", R_OPTIONS), ("h-cbf-qp", H_OPTIONS))
    }


@pytest.mark.physics
@pytest.mark.parametrize("program", ["r-cbf-qp", "h-cbf-qp"])
def test_the_filtered_a1_keeps_every_strict_region_at_every_physics_step(filtered, program):
    episode = filtered[program]
    assert not episode.fell
    assert episode.time[-1] == pytest.approx(20.0)
    assert (episode.min_h[:, :3] >= 0.0).all()
    assert episode.tracking_error[-1] <= 0.2
    assert (episode.status != FilterStatus.BACKUP).all()


@pytest.mark.physics
def test_h_takes_the_a1_out_of_region_2_sooner_and_less_deep_than_r(filtered):
    r, h = filtered["r-cbf-qp"], filtered["h-cbf-qp"]
    assert (h.h[:, 3] < 0).sum() < (r.h[:, 3] < 0).sum()
    assert np.maximum(-h.h[:, 3], 0).sum() < np.maximum(-r.h[:, 3], 0).sum()
    assert h.min_h[:, 3].min() > r.min_h[:, 3].min()


@pytest.mark.physics
def test_without_the_filter_the_a1_crosses_region_1_and_feed_forward_removes_the_lag():
    episode = Case(A1, "paper-simulation", "pd-ff", "none").run(seed=0)
    assert not episode.fell
    assert episode.min_h[:, 2].min() < -0.3
    assert episode.tracking_error[-1] <= 0.05


def test_the_printed_sign_of_h1_parks_the_robot_over_10_metres_short():
    episode = Case(ROM, "paper-simulation-as-printed", "pd", "r-cbf-qp", R_OPTIONS).run(seed=0)
    assert episode.tracking_error[-1] > 10.0
    assert not episode.reached
    assert episode.min_h[:, 0].min() >= 0.0
