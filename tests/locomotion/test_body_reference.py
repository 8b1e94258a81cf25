"""The reduced-order model that the trunk follows."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hcbf_gym._core import LEASH, MAX_YAW_ACCELERATION, MAX_YAW_RATE, advance_reference
from hcbf_gym.arrays import attributes, words_of
from hcbf_gym.locomotion.records import REFERENCE

DT = 0.002
ORIGIN = np.zeros(3)
examples = settings(deadline=None, max_examples=40)
speeds = st.floats(-1.0, 1.0)


def at_rest() -> tuple[np.record, np.ndarray]:
    """Return a reference at rest, and its bytes."""
    reference = np.zeros(1, dtype=REFERENCE)
    return attributes(reference), words_of(reference)


@examples
@given(speeds, speeds, st.floats(0.1, 0.5))
def test_the_reference_is_the_exact_double_integrator_below_its_cap(ux, uy, duration):
    (reference, packed), u = at_rest(), np.array([ux, uy])
    ticks = round(duration / DT)
    for _ in range(ticks):
        place = np.array([*reference.position, 0.27])  # a robot that keeps up
        advance_reference(packed, u, place, DT, 2.0, False, 1.0)
    t = ticks * DT
    np.testing.assert_allclose(reference.velocity, u * t, atol=1e-12)
    np.testing.assert_allclose(reference.position, 0.5 * u * t**2, atol=1e-12)
    np.testing.assert_allclose(reference.acceleration, u, atol=1e-9)


@examples
@given(
    st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=1, max_size=8),
    st.floats(0.1, 1.0),
)
def test_the_reference_keeps_to_speed_leash_and_yaw_limits(inputs, grip):
    reference, packed = at_rest()
    for u in inputs:
        for _ in range(50):
            rate = reference.yaw_rate
            advance_reference(packed, np.array(u), ORIGIN, DT, 1.2, True, grip)
            assert np.linalg.norm(reference.velocity) <= 1.2 + 1e-12
            assert np.linalg.norm(reference.position) <= LEASH + 1e-12
            assert abs(reference.yaw_rate) <= grip * MAX_YAW_RATE + 1e-12
            assert abs(reference.yaw_rate - rate) <= grip * MAX_YAW_ACCELERATION * DT + 1e-12


@examples
@given(st.floats(-np.pi, np.pi), st.floats(0.5, 1.0))
def test_the_heading_turns_to_the_velocity_without_overshoot(direction, grip):
    reference, packed = at_rest()
    u = np.array([np.cos(direction), np.sin(direction)])
    errors = []
    for _ in range(1500):
        place = np.array([*reference.position, 0.27])
        advance_reference(packed, u, place, DT, 0.8, True, grip)
        errors.append((direction - reference.yaw + np.pi) % (2 * np.pi) - np.pi)
    assert abs(errors[-1]) < 1e-3
    overshoot = -np.min(np.sign(errors[200]) * np.array(errors[200:]))
    assert overshoot < np.radians(0.5)


def test_the_heading_is_held_while_the_velocity_is_noise():
    (reference, packed), rng = at_rest(), np.random.default_rng(0)
    reference.yaw = 1.0
    for _ in range(500):
        reference.velocity[:] = rng.uniform(-0.1, 0.1, 2)
        advance_reference(packed, np.zeros(2), ORIGIN, DT, 1.2, True, 1.0)
    assert reference.yaw == 1.0
