"""What α₂ and α of speeds are unless they are given, and what each of them changes."""

import gymnasium as gym
import numpy as np
import pytest

import hcbf_gym
from hcbf_gym.barriers import BrakeClassK, HalfPlane, SpeedLimit
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.filter.settings import alphas_of
from hcbf_gym.models import DoubleIntegrator, Plant, Uncertainty
from hcbf_gym.models.input_sets import Box

U, T = Box.symmetric(5.0), 0.02
SLOW = {"alpha2": 2.0, "alpha_speed": 2.0}


@pytest.mark.parametrize(
    ("declared", "period", "gain"),
    [({}, 0.02, 2.0), ({}, 0.5, 1.0), ({}, None, 2.0), ({"gain": 10.0}, 0.02, 10.0),
     ({"gain": 10.0}, 0.1, 5.0), ({"gain": 0.5}, 0.02, 0.5)],
)  # fmt: skip
def test_a_plant_declares_its_gain_and_half_of_psi_is_left_after_a_hold(declared, period, gain):
    plant = Plant(DoubleIntegrator(), (), lambda *_: np.zeros(4), period=period, **declared)
    alphas = alphas_of({}, plant)
    assert (alphas["alpha2"].gain, alphas["alpha_speed"].gain) == (gain, gain)
    assert alphas_of({"alpha2": 3.0}, plant)["alpha2"].gain == 3.0
    with pytest.raises(hcbf_gym.HcbfError, match="gain: got None"):
        Plant(DoubleIntegrator(), (), lambda *_: np.zeros(4), gain=None)  # type: ignore[arg-type]


@pytest.mark.parametrize("gain", [None, 0.0, -1.0, np.nan, np.inf, "2", True, [2.0]])
def test_a_gain_that_is_no_positive_number_is_refused_where_it_is_declared(gain):
    with pytest.raises(InvalidInputError, match="plant: gain: got"):
        Plant(DoubleIntegrator(), (), lambda *_: np.zeros(4), gain=gain)


@pytest.mark.parametrize(
    ("declared", "gain"),
    [({}, 10.0), ({"body": 0.3, "confidence": 2.0}, 10.0)]
    + [({name: 0.1}, 2.0) for name in ("distance", "per_velocity", "per_lead", "cap", "speed")],
)
def test_a_batch_is_prompt_unless_its_plants_may_leave_their_model(declared, gain):
    wall, x = [HalfPlane("wall", 1, normal=(-1.0, 0.0), offset=-1.5)], np.array([0, 0, 1.5, 0])

    def answer(**options):
        filt = hcbf_gym.BatchFilter(U, T, uncertainty=Uncertainty(**declared), **options)
        filt.set_scene(wall)
        filt.reset(x=x)
        return filt(np.array([5.0, 0.0]), x)[0]

    np.testing.assert_array_equal(answer(), answer(alpha2=gain, alpha_speed=gain))
    assert (answer() != answer(alpha2=12.0 - gain)).any()


def test_environments_of_the_model_are_prompt_and_bodies_cautious():
    known = {"HCBF-Regions-v0": 10.0, "HCBF-A1Regions-v0": 2.0}
    made = {name: gym.make(name) for name in known}
    assert {name: env.unwrapped.plant.gain for name, env in made.items()} == known
    for env in made.values():
        env.close()


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
        for options in (SLOW, {}, {"alpha1": BrakeClassK(4.5, 0.09)})
    ]
    assert times[0] > 4.4 >= times[1] > 3.0 >= times[2]
