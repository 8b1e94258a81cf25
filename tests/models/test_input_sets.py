import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.models import Ball, Box, input_sets

SETS = [Box.symmetric(5.0), Box([-1.0, 0.0], [4.0, 2.5]), Ball(5.0), Ball(2.0, sides=3)]
coordinates = st.floats(-50.0, 50.0)


@pytest.mark.parametrize("input_set", SETS)
def test_halfspaces_hold_at_every_vertex_and_each_touches_two(input_set):
    a, b = input_set.halfspaces()
    heights = input_set.vertices() @ a.T - b
    np.testing.assert_allclose(np.linalg.norm(a, axis=1), 1.0)
    assert heights.min() > -1e-12
    assert ((np.abs(heights) < 1e-12).sum(axis=0) == 2).all()


@pytest.mark.parametrize("input_set", SETS)
def test_vertices_run_counter_clockwise(input_set):
    corners = input_set.vertices()
    edges = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edges, -1, axis=0)
    assert (edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0] > 0.0).all()


@pytest.mark.parametrize("input_set", SETS)
@given(x=coordinates, y=coordinates)
def test_projection_is_the_nearest_point(input_set, x, y):
    u = np.array([x, y])
    nearest = input_set.project(u)
    assert input_set.contains(nearest)
    # the separating hyperplane at the projection has the whole set on its other side
    assert ((input_set.vertices() - nearest) @ (u - nearest)).max() <= 1e-9 * (1.0 + x**2 + y**2)


@pytest.mark.parametrize("input_set", SETS)
def test_a_scaled_set_has_scaled_corners(input_set):
    np.testing.assert_allclose(
        input_set.scaled(0.3).vertices(), 0.3 * input_set.vertices(), atol=1e-15
    )


@pytest.mark.parametrize("input_set", SETS)
def test_json_round_trip_keeps_the_set(input_set):
    again = input_sets.from_dict(json.loads(json.dumps(input_set.to_dict())))
    np.testing.assert_array_equal(again.vertices(), input_set.vertices())


def test_polygon_lies_inside_its_disc_and_gives_away_what_is_stated():
    ball = Ball(3.0)
    distances = ball.halfspaces()[1]
    np.testing.assert_allclose(-distances, 3.0 * np.cos(np.pi / 16))
    assert np.linalg.norm(ball.vertices(), axis=1).max() <= 3.0 + 1e-12


@pytest.mark.parametrize(
    "fields",
    [
        {"kind": "box", "low": [0.1, -1.0], "high": [1.0, 1.0]},  # no braking action
        {"kind": "box", "low": [1.0, 1.0], "high": [-1.0, -1.0]},  # empty
        {"kind": "box", "low": [-1.0, -1.0], "high": [1.0]},
        {"kind": "box", "low": [], "high": []},
        {"kind": "box", "low": [-1.0, -np.inf], "high": [1.0, 1.0]},
        {"kind": "box", "low": [-1.0], "high": [1.0], "radius": 1.0},
        {"kind": "ball", "radius": -1.0},
        {"kind": "ball", "radius": 1.0, "sides": 2},
        {"kind": "ball", "radius": 1.0, "sides": 16.0},
        {"kind": "ball"},
        {"radius": 1.0},
    ],
)
def test_impossible_sets_are_refused(fields):
    with pytest.raises(InvalidInputError):
        input_sets.from_dict(fields)


def test_unknown_kind_names_the_choices():
    with pytest.raises(UnknownNameError, match="ball"):
        input_sets.from_dict({"kind": "simplex"})


def test_limits_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        Box.symmetric(1.0).low[0] = -2.0
