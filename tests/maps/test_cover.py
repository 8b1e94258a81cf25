import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hcbf_gym.errors import InvalidInputError
from hcbf_robots.maps import Grid, MapClass, RankedMap
from hcbf_robots.maps.cover import MOST_PIECES, Cover
from tests.maps.floors import ORIGINS, cells, room, true_distance

CELL = 0.05


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize("seed", range(3))
def test_the_covered_distance_never_exceeds_the_true_one_and_is_hardly_short_of_it(seed, origin):
    ranked = room(seed, origin)
    rng = np.random.default_rng(seed)
    points = ranked.grid.to_world(rng.uniform([-10, -10], [90, 70], (4000, 2)))
    true = true_distance(ranked, ranked.classes[0].cells, points)
    covered = ranked.distance(points, 1)
    assert (covered <= true).all()
    near = true < 1.0
    assert np.quantile((true - np.maximum(covered, 0.0))[near], 0.95) <= 1.5 * CELL


@pytest.mark.parametrize("turn", [0.0, 0.4, np.pi / 4])
def test_a_gap_narrows_by_two_cells_at_most(turn):
    rows, columns = np.indices((200, 200))
    along = np.cos(turn) * (columns - 100) + np.sin(turn) * (rows - 100)
    across = np.cos(turn) * (rows - 100) - np.sin(turn) * (columns - 100)
    wall = (np.abs(across) < 3.0) & (np.abs(along) > 10.0)
    ranked = RankedMap(Grid(CELL, (0, 0, 0), wall.shape), (MapClass("w", 1, "keepout", wall),))
    steps = np.linspace(-9.0, 9.0, 50)[:, None]
    path = (100.5 + steps * np.array([[-np.sin(turn), np.cos(turn)]])) * CELL  # through the middle
    true = true_distance(ranked, wall, path)
    assert (true - ranked.distance(path, 1) <= CELL + 1e-6).all()


def left(cover, piece, points):
    """Return how far points (k, 2) are on the left of each edge of a piece (k, e)."""
    corners = cover.corners[piece, : cover.sizes[piece]]
    edges = np.roll(corners, -1, axis=0) - corners
    offset = points[:, None] - corners
    return edges[:, 0] * offset[..., 1] - edges[:, 1] * offset[..., 0]


CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])  # of a cell


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 50), st.integers(0, 60))
def test_a_cover_after_a_change_covers_what_is_there_now(seed, r, c):
    rng = np.random.default_rng(seed)
    before = cells(seed)
    now = before.copy()
    window = now[r : r + 12, c : c + 17]
    window ^= rng.random(window.shape) < 0.2
    cover = Cover.of(before).after(now, (r, c, r + window.shape[0], c + window.shape[1]))
    assert ((cover.owner >= 0) == now).all()
    for piece in np.unique(cover.owner[now]):
        lows = np.argwhere(cover.owner == piece)[:, ::-1]
        assert (left(cover, piece, (lows[:, None] + CORNERS).reshape(-1, 2)) >= 0).all()


def test_a_change_far_from_a_piece_leaves_it_as_it_is():
    ranked = room(0)
    window = np.ones((2, 2), dtype=np.bool_)
    changed = ranked.update((55, 75), {"walls": window})
    assert not ranked.classes[0].cells[55:57, 75:77].all()
    assert changed.classes[0].cells[55:57, 75:77].all()
    old = {tuple(map(tuple, piece)) for piece in ranked.polygons("walls")}
    new = {tuple(map(tuple, piece)) for piece in changed.polygons("walls")}
    assert len(old - new) <= 3
    anew = RankedMap(changed.grid, changed.classes)
    points = np.random.default_rng(0).uniform(0.0, 4.0, (500, 2))
    assert np.abs(changed.distance(points, 1) - anew.distance(points, 1)).max() <= 1.5 * CELL


def rasters(side):
    """Yield name → cells that are hard to cover."""
    rng = np.random.default_rng(0)
    r, c = np.indices((side, side))
    yield "checkerboard", (r + c) % 2 == 0
    yield "dots", (r % 2 == 0) & (c % 2 == 0)
    for share in (0.02, 0.1, 0.3, 0.5, 0.7, 0.9):
        yield f"random {share:.0%}", rng.random((side, side)) < share
    yield "stripes", r % 2 == 0
    yield "diagonal stripes", (r + c) % 3 == 0
    yield "steep stripes", (3 * r + c) % 7 == 0
    yield "crooked stripes", (1.618 * r + c) % 5.0 < 1.0
    yield "triangle", r + c >= side
    yield "comb", (r < 2) | (c % 2 == 0)
    x, y = c - side / 2.0, r - side / 2.0
    yield "spiral", (np.hypot(x, y) / 2.5 - np.arctan2(y, x) / np.pi) % 2.0 < 1.0
    yield "rings", np.hypot(x, y) % 3.0 < 1.0
    yield "full", np.ones((side, side), dtype=np.bool_)
    yield "noise in rooms", (rng.random((side, side)) < 0.01) | (r % 100 == 0) | (c % 100 == 0)


HARD = dict(rasters(600))


@pytest.mark.parametrize("name", HARD)
def test_a_cover_is_exact_whatever_the_raster(name):
    cells, rng = HARD[name], np.random.default_rng(0)
    cover = Cover.of(cells)
    assert ((cover.owner >= 0) == cells).all()
    near = cells.copy()
    near[1:] |= cells[:-1]
    near[:-1] |= cells[1:]
    near[:, 1:] |= cells[:, :-1]
    near[:, :-1] |= cells[:, 1:]
    places = np.argwhere(cells)
    for row, column in places[rng.integers(len(places), size=300)]:
        piece = cover.owner[row, column]
        assert (left(cover, piece, np.array([column, row]) + CORNERS) >= 0).all()
        corners = cover.corners[piece, : cover.sizes[piece]]
        points = rng.uniform(corners.min(axis=0), corners.max(axis=0), (200, 2))
        points = points[(left(cover, piece, points) > 1e-9).all(axis=1)]
        column_of, row_of = np.floor(points).astype(int).T
        assert near[row_of, column_of].all()


@pytest.mark.parametrize("name", HARD)
def test_a_million_cells_are_covered_within_three_seconds(name):
    cells = dict(rasters(1000))[name]
    Cover.of(cells[:3, :3].copy())
    begun = time.process_time()
    Cover.of(cells)
    assert time.process_time() - begun < 3.0


def test_a_raster_of_too_many_pieces_is_refused_with_their_number_and_the_remedy():
    cells = np.zeros((1500, 1500), dtype=np.bool_)
    cells[::2, ::2] = True
    with pytest.raises(InvalidInputError, match=r"need 562500 convex pieces.*coarser resolution"):
        Cover.of(cells)
    cells[1000:] = False
    cover = Cover.of(cells)
    assert len(cover.sizes) == 375_000 < MOST_PIECES
