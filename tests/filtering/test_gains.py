"""What α₂ and α of speeds are unless they are given, and what each of them changes."""

import numpy as np
import pytest

import hcbf_gym
from hcbf_gym.barriers import BrakeClassK, HalfPlane, SpeedLimit
from hcbf_gym.filter.settings import alphas_of
from hcbf_gym.models import DoubleIntegrator, Plant, Uncertainty
from hcbf_gym.models.input_sets import Box
from tests.worlds import boat

U, T = Box.symmetric(5.0), 0.02


@pytest.mark.parametrize(
    ("model", "period", "uncertainty", "gain"),
    [
        (DoubleIntegrator(), 0.02, Uncertainty(distance=0.1), 10.0),
        (DoubleIntegrator(), 0.1, Uncertainty(), 5.0),
        (DoubleIntegrator(), None, Uncertainty(), 2.5),  # T = 0.2 s, the longest
        (DoubleIntegrator(), 0.02, Uncertainty(per_velocity=0.7, cap=0.25), 2.0),
        (boat(), 0.02, Uncertainty(), 2.0),  # its rows look at the sample alone
    ],
)
def test_half_of_psi_is_left_after_a_hold_and_the_cautious_gain_elsewhere(
    model, period, uncertainty, gain
):
    plant = Plant(model, (), lambda *_: np.zeros(4), period=period, uncertainty=uncertainty)
    alphas = alphas_of({}, plant)
    assert (alphas["alpha2"].gain, alphas["alpha_speed"].gain) == (gain, gain)
    assert alphas_of({"alpha2": 3.0}, plant)["alpha2"].gain == 3.0


def first(reached, scene, x, **options):
    """Return after how long a robot under a full input has what `reached` looks for [s]."""
    filt = hcbf_gym.BatchFilter(U, T, **options)
    filt.set_scene(scene)
    filt.reset(x=x)
    for k in range(600):
        u, report = filt(np.array([5.0, 0.0]), x)
        x = DoubleIntegrator().step(x, u, T)
        assert report["status"] < 3
        if reached(x):
            return (k + 1) * T
    raise AssertionError("never")


def test_a_robot_reaches_its_speed_limit_soon_unless_alpha_of_speeds_is_low():
    scene, fast = [SpeedLimit("cap", 1, 1.0)], lambda x: x[2] >= 0.95
    for options in ({}, {"alpha2": 2.0}):
        assert first(fast, scene, np.zeros(4), **options) <= 0.35
    assert first(fast, scene, np.zeros(4), alpha_speed=2.0) > 1.0


def test_a_sprint_to_a_wall_takes_no_longer_than_the_functions_permit():
    wall, x = [HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-10.0)], np.zeros(4)
    times = [
        first(lambda x: x[0] > 9.95, wall, x, **options)
        for options in ({"alpha2": 2.0}, {}, {"alpha1": BrakeClassK(4.5, 0.09)})
    ]
    assert times[0] > 4.4 >= times[1] > 3.0 >= times[2]
