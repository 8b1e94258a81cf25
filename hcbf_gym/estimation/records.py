"""Records that the compiled estimator and Python share; `core/include/hcbf/` has their fields."""

from hcbf_gym.arrays import record_type

AXIS = 5
"""Entries of an axis's state [p, v, d, a, s]: position, velocity, drift of the fix, error of the
acceleration, slip of the feet."""
P, V, D, A, S = range(AXIS)

SETTINGS = record_type("estimation_tick.Settings")
