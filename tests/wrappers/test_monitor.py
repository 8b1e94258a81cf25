"""When an environment that does not apply u is an alarm."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hcbf_gym import _core
from hcbf_gym.arrays import numbers_of
from hcbf_gym.filter import plants
from hcbf_gym.models.plant import Reason

PERIOD, LIMIT = 0.02, 5.0
RADIUS = LIMIT * np.sqrt(2.0)


def alarmed(inputs, applied):
    """Whether a monitor alarms, where `applied[k]` came of `inputs[k]`."""
    records = np.zeros(1, dtype=plants.PLANT)
    plant = records[0]
    plant["elapsed"] = PERIOD
    for u, really in zip(inputs, applied, strict=True):
        plant.time += PERIOD
        assert _core.check_states(numbers_of(records)) == 0
        _core.monitor_watch(numbers_of(records), RADIUS, 3.0, exact=True, observed=True)
        plant.input[:] = u
        plant.x[:2] += PERIOD * plant.x[2:] + 0.5 * PERIOD**2 * really
        plant.x[2:] += PERIOD * really
    return plant.alarm == Reason.INPUT


seeds = st.integers(0, 2**32 - 1)


def wanted(seed, count=200):
    """Inputs that a policy may ask for: each held for a while, of any size."""
    rng = np.random.default_rng(seed)
    held = rng.uniform(-LIMIT, LIMIT, (count // 10, 2)) * rng.random((count // 10, 1))
    return np.repeat(held, 10, axis=0)


@given(seeds, st.floats(0.0, 0.3))
def test_an_environment_that_applies_u_nearly_is_no_alarm(seed, off):
    u, rng = wanted(seed), np.random.default_rng(seed)
    error = rng.uniform(-off, off, u.shape) * np.linalg.norm(u, axis=1, keepdims=True)
    assert not alarmed(u, u + error)


@given(seeds)
def test_a_gain_of_two_that_is_cut_off_at_the_limits_is_one(seed):
    u = wanted(seed)
    assert alarmed(u, np.clip(2.0 * u, -LIMIT, LIMIT))
    assert alarmed(0.1 * u + 0.3, 0.2 * u + 0.6)


@given(seeds)
def test_a_delay_and_a_hold_are_alarms(seed):
    u = wanted(seed)
    assert alarmed(u, np.vstack([np.zeros((10, 2)), u[:-10]]))
    assert alarmed(u, np.repeat(u[::25], 25, axis=0))


@given(seeds)
def test_few_inputs_that_an_exact_plant_misses_are_an_alarm(seed):
    u = wanted(seed)
    third = np.where(np.arange(len(u))[:, None] % 3 == 0, -1.0, 1.0)
    assert alarmed(0.1 * u + 0.6, third * (0.1 * u + 0.6))
    weak = np.where(np.arange(len(u))[:, None] % 20 >= 14, 0.6, 1.0)
    assert alarmed(0.1 * u + 0.6, weak * (0.1 * u + 0.6))


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_noise_at_rest_is_no_alarm(noise):
    rng = np.random.default_rng(0)
    u = rng.uniform(-0.1, 0.1, (300, 2))
    assert not alarmed(u, u + rng.normal(0.0, noise, u.shape))
