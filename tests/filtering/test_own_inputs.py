"""A U of each plant: what a robot can do turns with its heading."""

import numpy as np
import pytest

import hcbf_gym
from hcbf_gym.barriers import Disc
from hcbf_gym.models.input_sets import Box
from hcbf_gym.programs import FilterStatus

T, N = 0.02, 150
SCENE = [Disc("strict", 1, (0.6, 0.0), 0.4), Disc("soft", 2, (0.0, 0.5), 0.4)]


def rectangles(angles):
    """(N, 4, 2) corners of 4 x 1 m/s² along headings, counter-clockwise."""
    corner = np.array([[-4.0, -1.0], [4.0, -1.0], [4.0, 1.0], [-4.0, 1.0]])
    cos, sin = np.cos(angles), np.sin(angles)
    turn = np.moveaxis(np.array([[cos, -sin], [sin, cos]]), -1, 0)
    return np.einsum("nij,kj->nki", turn, corner)


def begun(count, x, vertices, **options):
    filt = hcbf_gym.BatchFilter(Box.symmetric(5.0), T, count, **options)
    filt.set_scene(SCENE)
    filt._core.set_inputs(vertices)
    filt.reset(x=x)
    return filt


@pytest.fixture
def drawn():
    rng = np.random.default_rng(0)
    x = rng.uniform(-0.3, 0.15, (N, 4))
    return x, rectangles(rng.uniform(0.0, 2.0 * np.pi, N)), rng.uniform(-5.0, 5.0, (N, 2))


def inside(vertices, u):
    side = np.roll(vertices, -1, axis=1) - vertices
    to = u[:, None] - vertices
    return (side[..., 0] * to[..., 1] - side[..., 1] * to[..., 0]).min(axis=1) >= -1e-9


@pytest.mark.parametrize("program", ["lex-cbf-qp", "eh-cbf-qp"])
def test_each_plant_gets_an_input_of_its_set_as_it_would_alone(drawn, program):
    x, vertices, wanted = drawn
    many = begun(N, x, vertices, program=program)
    parts = begun(N, x, vertices, program=program, threads=2)
    u, report = many(wanted, x)
    assert inside(vertices, u).all()
    np.testing.assert_array_equal(u, parts(wanted, x)[0])
    assert (report["status"] == FilterStatus.SAFE).any()
    for i in range(0, N, 10):
        alone = begun(1, x[i : i + 1], vertices[i : i + 1], program=program)
        np.testing.assert_array_equal(u[i], alone(wanted[i : i + 1], x[i : i + 1])[0][0])


def test_a_plant_brakes_by_the_nearest_input_of_its_set(drawn):
    x, vertices, wanted = drawn
    many = begun(N, x, vertices)
    first, _ = many(wanted, x)
    lost = np.full_like(x, np.nan)
    with pytest.warns(UserWarning, match="brakes"):
        u, _ = many(wanted, lost)
    assert inside(vertices, u).all()
    v = x[:, 2:] + T * first
    assert ((u * v).sum(axis=1) <= 1e-9).all()
    fits = inside(vertices, -v / T)
    np.testing.assert_allclose(u[fits], -v[fits] / T, atol=1e-12)
    assert fits.any()


def test_sets_that_turn_count_from_the_next_step_on(drawn):
    x, vertices, wanted = drawn
    many = begun(N, x, rectangles(np.zeros(N)))
    many(wanted, x)
    many._core.set_inputs(vertices)
    u, _ = many(wanted, x)
    np.testing.assert_array_equal(u, begun(N, x, vertices)(wanted, x)[0])
