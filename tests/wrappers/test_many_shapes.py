"""Many shapes of one kind as one entry of a list: `barriers.Shapes` behind the filter."""

import numpy as np
import pytest
from point_mass import AHEAD, filtered, quietly

from hcbf_gym import barriers


def test_360_discs_are_one_entry_and_filter_as_360_objects_do():
    angle = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    values = np.column_stack([2.0 * np.cos(angle), 2.0 * np.sin(angle), np.full(360, 0.1)])
    listed = [barriers.Disc(str(k), 1, tuple(v[:2]), v[2]) for k, v in enumerate(values)]
    one = filtered(listed=lambda: [barriers.Shapes("scan", 1, "disc", values)])
    many = filtered(listed=listed)
    for env in (one, many):
        env.reset(seed=0)
    for step in range(60):
        u = np.array([5.0, 2.0 * np.sin(0.1 * step)])
        first, second = quietly(one, u), quietly(many, u)
        np.testing.assert_array_equal(first["u_safe"], second["u_safe"])
        assert first["status"] == second["status"]
    assert first["slack"].shape == (360,)


@pytest.mark.parametrize("shape", ["disc", "half-plane", "convex-polygon"])
def test_no_shape_in_sight_is_an_entry_of_length_0(shape):
    nothing = barriers.Shapes("many", 1, shape, [])
    assert len(nothing) == 0
    env = filtered(listed=(nothing,))
    env.reset(seed=0)
    np.testing.assert_array_equal(quietly(env)["u_safe"], AHEAD)
