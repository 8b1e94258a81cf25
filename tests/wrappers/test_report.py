"""What info["safety_filter"] holds: the fields of `filtering.report`, from every core."""

import gymnasium as gym
import numpy as np
import pytest

import hcbf_gym  # noqa: F401 - registers the environments
from hcbf_gym.filter import bound
from hcbf_gym.wrappers import SafetyFilter, VectorSafetyFilter

U = np.array([1.0, 0.5])


def filtered(solver=None):
    env = gym.make("HCBF-Regions-v0", scenario="paper-simulation")
    return SafetyFilter(env, solver=solver)


@pytest.mark.parametrize("solver", [None, "daqp"])
def test_one_plant_reports_every_field_as_an_array_or_a_scalar_of_numpy(solver):
    env = filtered(solver)
    _, at_reset = env.reset(seed=0)
    *_, at_step = env.step(U)
    for reported in (at_reset["safety_filter"], at_step["safety_filter"]):
        assert {*(bound.plant_dtype(2).names or ()), *(bound.ROW.names or ())} <= set(reported)
        for name in bound.plant_dtype(2).names or ():
            kind = bound.plant_dtype(2)[name]
            assert np.shape(reported[name]) == kind.shape
            assert np.asarray(reported[name]).dtype == kind.base
            assert isinstance(reported[name], np.ndarray | np.generic)
        for name in bound.ROW.names or ():
            assert reported[name].shape == reported["slack"].shape


def test_a_batch_reports_the_same_fields_with_a_leading_axis():
    envs = VectorSafetyFilter(gym.make_vec("HCBF-Regions-v0", num_envs=3), guidance="geodesic")
    envs.reset(seed=0)
    *_, info = envs.step(np.tile(U, (3, 1)))
    reported = info["safety_filter"]
    one = filtered()
    one.reset(seed=0)
    *_, of_one = one.step(U)
    assert {name for name in reported if not name.startswith("_")} == set(of_one["safety_filter"])
    assert all(len(value) == 3 for value in reported.values())


def test_a_report_is_not_changed_by_the_next_step():
    envs = VectorSafetyFilter(gym.make_vec("HCBF-Regions-v0", num_envs=2))
    for env, u in ((filtered(), U), (envs, np.tile(U, (2, 1)))):
        env.reset(seed=0)
        *_, info = env.step(u)
        reported = info["safety_filter"]
        before = {name: np.array(value) for name, value in reported.items()}
        for _ in range(3):
            env.step(-3.0 * u)
        for name, value in before.items():
            assert np.array_equal(reported[name], value)
