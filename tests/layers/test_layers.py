"""Layers: the filter's own u, its derivatives, and where there are none."""

import numpy as np
import pytest
from central_differences import SETTINGS, compare, points, scene

from hcbf_gym import _core, programs
from hcbf_gym.barriers import BarrierSet, CbfRows, HalfPlane, RowSettings, SpeedLimit
from hcbf_gym.errors import InvalidInputError, UnknownNameError
from hcbf_gym.filter.settings import input_limits
from hcbf_gym.layers.flat import FlatFilter
from hcbf_gym.models import Box
from tests.worlds import OwnLinear

PROGRAMS = [
    ("lex-cbf-qp", {}),
    ("cbf-qp", {}),
    ("r-cbf-qp", {}),
    ("r-cbf-qp", {"epsilon": "known"}),
    ("ih-cbf-qp", {}),
    ("eh-cbf-qp", {}),
]
WALL = HalfPlane("wall", 1, normal=(1.0, 0.0), offset=0.0)
OBLIQUE = HalfPlane("oblique", 1, normal=(0.8, 0.6), offset=0.0)


def rng():
    return np.random.default_rng(1)


def variables(flat, u_nominal, x):
    margins = np.concatenate([flat.blocks, np.zeros((len(flat.blocks), 3))], axis=1)
    return np.concatenate([u_nominal, x, margins.ravel()])[None], np.zeros(1)


@pytest.mark.parametrize("name", SETTINGS)
def test_u_is_that_of_rows_and_program_bit_for_bit(name):
    barriers = scene(rng(), 4)
    flat, given = FlatFilter(barriers, **SETTINGS[name]), SETTINGS[name]
    v, t = points(rng(), flat, 100)
    scenes, own = BarrierSet([barriers] * 100), v[:, 6:].reshape(100, len(barriers), 22)
    margin = np.ascontiguousarray(own[:, :, 19:].transpose(2, 0, 1))
    inputs = given["input_set"]
    alphas = {name: given[name] for name in ("alpha1", "alpha_speed") if name in given}
    settings = RowSettings(
        period=given.get("period"), u_max=inputs.radius, limits=input_limits(inputs), **alphas
    )
    a, out = np.empty((*scenes.kind.shape, 2)), np.empty((4, *scenes.kind.shape))
    x = np.ascontiguousarray(v[:, 2:6])
    _core.planar_rows(scenes.kind, scenes.parameters, margin, x, t, settings.packed, a, out)
    rows = CbfRows(a, out[0], out[1], scenes.priority, out[2])
    expected = programs.make_batch("lex-cbf-qp", input_set=inputs)(v[:, :2], rows)
    u, status, _ = flat.filter(v, t)
    np.testing.assert_array_equal(u, expected.u)
    np.testing.assert_array_equal(status, expected.status)


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize(("program", "options"), PROGRAMS)
def test_derivatives_are_those_of_central_differences(program, options, name):
    errors, status = compare(rng(), name, program, **options)
    assert np.isfinite(errors).sum() >= 40
    assert (status > 0).sum() >= 20
    assert np.nanmax(errors) <= 1e-6


def test_conflicts_of_many_rows_of_one_rank_have_derivatives():
    source, relaxed = rng(), 0
    for name in [*SETTINGS] * 3:
        errors, status = compare(source, name, ranks=1)
        relaxed += (status[np.isfinite(errors)] > 1).sum()
        assert np.nanmax(errors) <= 1e-6
    assert relaxed >= 20


@pytest.mark.parametrize(
    ("barriers", "u_nominal", "x"),
    [
        ([OBLIQUE], (0.0, 0.0), (1.0, 1.0, 0.0, 0.0)),  # moved so that the row is just met, below
        ([WALL], (1.0, 5.0), (1.0, 0.0, 0.0, 0.0)),  # on a side of U
        ([WALL], (-1.0, 1.0), (-9.0, 0.0, -9.0, 0.0)),  # U has the wall's direction, which may turn
        ([OBLIQUE, OBLIQUE], (-4.0, -4.0), (1.0, 1.0, 0.0, 0.0)),  # two rows in one place
    ],
    ids=["on a row", "on U", "parallel to U", "two at once"],
)
def test_ties_are_degenerate_and_their_neighbours_are_not(barriers, u_nominal, x):
    flat = FlatFilter(barriers)
    v, t = variables(flat, u_nominal, x)
    if barriers == [OBLIQUE]:  # u in the row's direction is on the row itself
        v[0, :2] = (-4.0, -4.0)
        v[0, :2] = flat.filter(v, t)[0][0]
    assert flat.filter(v, t)[2].all()
    elsewhere, _ = variables(FlatFilter([OBLIQUE]), (-4.0, -3.0), (1.0, 1.0, 0.1, 0.2))
    assert not FlatFilter([OBLIQUE]).filter(elsewhere, t)[2].any()


def test_where_u_has_no_derivative_it_has_that_of_one_side():
    flat = FlatFilter([OBLIQUE])
    v, t = variables(flat, (-4.0, -4.0), (1.0, 1.0, 0.0, 0.0))
    v[0, :2] = flat.filter(v, t)[0][0]
    u = flat.filter(v, t)[0][0]
    for j in range(2, 6):  # along the state's axes
        step = np.zeros_like(v)
        step[0, j] = 1e-6
        ahead, behind = (flat.filter(v + side * step, t)[0][0] for side in (1.0, -1.0))
        of_u = [flat.pull_back(v, t, w[None])[0, j] for w in np.eye(2)]
        sides = (ahead - u) / 1e-6, (u - behind) / 1e-6
        assert any(np.allclose(of_u, side, atol=1e-4) for side in sides)


def test_rows_along_an_axis_have_derivatives_in_conflict_too():
    """A Givens rotation is skipped where an entry is 0, and its derivative is not 0."""
    normals = (0.0, 1.0), (0.8, -0.6), (-0.8, -0.6)
    flat = FlatFilter([HalfPlane(f"{n}", 1, normal=n, offset=1.0) for n in normals])
    v, t = variables(flat, (1.0, 1.0), (0.1, 0.2, 0.2, -0.1))
    (u,), status, degenerate = flat.filter(v, t)
    assert status == [3]
    assert not degenerate
    assert np.abs(u).max() < 4.0
    steps = 1e-6 * np.eye(v.shape[1])
    ahead, behind = (flat.filter(v + side * steps, np.zeros(len(steps)))[0] for side in (1, -1))
    of_u = [flat.pull_back(v, t, w[None])[0] for w in np.eye(2)]
    np.testing.assert_allclose((ahead - behind).T / 2e-6, of_u, rtol=1e-6, atol=1e-6)


def test_other_barriers_and_settings_are_refused():
    with pytest.raises(InvalidInputError, match="number 1 of another kind, expected shapes"):
        FlatFilter([WALL, OwnLinear("own", 1)])
    with pytest.raises(UnknownNameError, match="lex-cbf-qp"):
        FlatFilter([WALL], program="none of these")
    with pytest.raises(InvalidInputError, match="period"):
        FlatFilter([WALL], period=-1.0)
    with pytest.raises(InvalidInputError, match="speed limit"):
        FlatFilter([SpeedLimit("v", 1, v_max=0.01)], period=0.1, input_set=Box.symmetric(4.0))


def test_entries_that_are_not_finite_are_named():
    flat = FlatFilter([WALL])
    v, t = variables(flat, (0.0, np.nan), (1.0, 0.0, 0.0, 0.0))
    with pytest.raises(InvalidInputError, match=r"state 0: .* expected finite numbers"):
        flat.filter(v, t)
