"""Circulation where no goal is known: it walks along what stops the policy, on a latched side."""

import numpy as np
import pytest

from hcbf_gym import guidance, programs
from hcbf_gym.barriers import BarrierSet, CbfRows, ConvexPolygon, Disc, RowSettings
from hcbf_gym.barriers.planar_rows import planar_rows
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.guidance import local

FLAT = ConvexPolygon("flat", 1, ((1.0, -1.0), (2.0, -1.0), (2.0, 1.0), (1.0, 1.0)))
GOAL = np.array([4.0, 0.0])


def row(around, x, t, u_nominal):
    """a (2,) and b of one state."""
    out = np.empty((1, 3))
    around.write_rows(np.array([x]), np.array([t]), np.array([u_nominal]), out)
    return out[0, :2], out[0, 2]


def walk(barriers, guided, steps=1000):
    """Where PD gets under the filter, with the circulation row or without."""
    scenes, program = BarrierSet([barriers]), programs.make_batch("lex-cbf-qp")
    around = guidance.Local()
    around.reset(scenes)
    x = np.zeros((1, 4))
    for step in range(steps):
        t = np.array([0.02 * step])
        u_nominal = 2.0 * (GOAL - x[:, :2]) - 3.0 * x[:, 2:]
        rows = planar_rows(scenes, x, t, RowSettings(), 0.03)
        if guided:
            out = np.empty((len(x), 3))
            around.write_rows(x, t, u_nominal, out)
            a, b = out[:, :2], out[:, 2]
            rows = CbfRows(
                np.concatenate([rows.a, a[:, None]], axis=1),
                np.concatenate([rows.b, b[:, None]], axis=1),
                np.concatenate([rows.h, np.ones((1, 1))], axis=1),
                np.concatenate(
                    [rows.priority, rows.priority.max(keepdims=True)[:, :1] + 1], axis=1
                ),
            )
        u = program(u_nominal, rows).u
        x = np.hstack([x[:, :2] + 0.02 * x[:, 2:] + 0.0002 * u, x[:, 2:] + 0.02 * u])
    return x[0, :2]


@pytest.mark.parametrize("barriers", [[FLAT], [Disc("disc", 1, (2.0, 0.0), 1.0)]])
def test_it_passes_a_convex_region_before_which_the_filter_alone_parks(barriers):
    assert np.linalg.norm(walk(barriers, guided=False) - GOAL) > 2.0
    assert np.linalg.norm(walk(barriers, guided=True) - GOAL) < 0.25


def test_the_row_runs_along_the_edge_on_the_side_of_the_nominal_input():
    for side in (0.5, -0.5):
        around = guidance.Local()
        around.reset([FLAT])
        a, b = row(around, np.array([0.8, 0.0, 0.0, 0.0]), 0.0, np.array([3.0, side]))
        np.testing.assert_allclose(a, [0.0, np.sign(side)], atol=1e-12)
        assert b > 0.0


def test_the_side_is_kept_until_the_robot_stands_and_then_flipped():
    around = guidance.Local()
    around.reset([FLAT])
    still, moving = np.array([0.8, 0.0, 0.0, 0.0]), np.array([0.8, 0.0, 0.0, 0.3])
    first, _ = row(around, moving, 0.0, np.array([3.0, 0.5]))
    kept, _ = row(around, moving, 5.0, np.array([3.0, -0.5]))
    np.testing.assert_array_equal(kept, first)
    row(around, still, 5.0 + 0.9 * local.STUCK, np.array([3.0, -0.5]))
    flipped, _ = row(around, still, 5.0 + 1.1 * local.STUCK, np.array([3.0, -0.5]))
    np.testing.assert_array_equal(flipped, -first)


def test_where_nothing_stops_the_policy_there_is_no_row_and_the_side_is_forgotten():
    around = guidance.Local()
    around.reset([FLAT])
    row(around, np.array([0.8, 0.0, 0.0, 0.0]), 0.0, np.array([3.0, 0.5]))
    for x, u in (((-1.0, 0.0), (3.0, 0.0)), ((0.8, 0.0), (-3.0, 0.0))):
        a, b = row(around, np.array([*x, 0.0, 0.0]), 0.1, np.array(u))
        assert (a == 0.0).all()
        assert b < 0.0
        assert around.memory[0, 0] == 0.0


def test_what_cannot_be_is_refused():
    with pytest.raises(InvalidInputError, match="reset"):
        row(guidance.Local(), np.zeros(4), 0.0, np.zeros(2))
    with pytest.raises(InvalidInputError, match="count"):
        guidance.Local(0)
    with pytest.raises(InvalidInputError, match="scenes"):
        guidance.Local(2).reset([FLAT])
