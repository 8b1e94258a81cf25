"""What every built-in shape keeps, whichever there are."""

import dataclasses
import importlib
import json
from pathlib import Path

import numpy as np
import pytest
import readable

from hcbf_gym import _core, barriers
from hcbf_gym.barriers import Barrier, Oval, Shapes, Wall, layout, shapes
from hcbf_gym.errors import InvalidInputError

ALL = [cls(cls.kind, 1) for cls in shapes.SHAPES]
BOUNDED = [shape for shape in ALL if not isinstance(shape.outline(), Wall)]


DOCS = Path(__file__).parents[2] / "docs"


def named(shape):
    return shape.kind


def block_of(shape):
    block = np.zeros(layout.WIDTH)
    return shape.write(block), block


def corners_of(shape):
    drawn = shape.outline()
    return drawn.corners() if isinstance(drawn, Oval) else drawn


def points(n, seed=0):
    return np.random.default_rng(seed).uniform(-3.0, 3.0, (n, 2))


def test_kinds_and_codes_distinguish_shapes():
    codes = [shape.code for shape in ALL]
    assert {shape.kind: shape.code for shape in ALL} == _core.SHAPES
    assert codes == [block_of(shape)[0] for shape in ALL]
    assert len(set(codes)) == len({shape.kind for shape in ALL}) == len(ALL)
    assert min(codes) >= 0
    assert max(codes) < layout.SPEED_LIMIT
    assert [cls.__name__ for cls in sorted(shapes.SHAPES, key=lambda c: c.__name__)] == sorted(
        shapes.__all__
    )


@pytest.mark.parametrize("cls", shapes.SHAPES)
def test_it_has_a_text_in_numpy_and_is_on_the_pages(cls):
    assert cls in readable.TEXTS
    assert f"::: hcbf_gym.barriers.{cls.__name__}\n" in (DOCS / "api" / "barriers.md").read_text()
    assert f"`{cls.kind}`" in (DOCS / "environments.md").read_text()


def test_python_and_compiled_code_have_the_same_numbers():
    for name, number in _core.barrier_columns():
        module, _, column = name.rpartition(".")
        assert getattr(importlib.import_module(f"hcbf_gym.barriers.{module}"), column) == number


@pytest.mark.parametrize("shape", ALL, ids=named)
def test_h_is_convex_no_steeper_than_1_and_has_its_gradient(shape):
    for q, other in zip(points(200), points(200, 1), strict=True):
        h, gradient, hessian = shape.planar_jet(q)
        assert shape.planar_jet(0.5 * (q + other))[0] <= 0.5 * (h + shape.planar_jet(other)[0]) + (
            1e-12
        )
        steepness = np.linalg.norm(gradient)
        assert steepness <= 1.0 + 1e-12
        assert steepness == pytest.approx(1.0)
        ahead, behind = (
            np.array([shape.planar_jet(q + s * e)[0] for e in np.eye(2)]) for s in (1e-6, -1e-6)
        )
        np.testing.assert_allclose((ahead - behind) / 2e-6, gradient, atol=1e-5)
        assert np.linalg.eigvalsh(hessian).min() >= -1e-12


@pytest.mark.parametrize("shape", ALL, ids=named)
def test_the_core_is_where_the_gradient_does_not_turn(shape):
    rng = np.random.default_rng(2)
    for q in points(300, 2):
        h, gradient, _ = shape.planar_jet(q)
        reach = rng.uniform(0.01, 0.5)
        core = shape.core(q, reach)
        if np.isfinite(core.distance):
            assert core.distance - core.radius == pytest.approx(h)
        elif h > 0.0:
            for _ in range(20):
                angle = rng.uniform(0.0, 2.0 * np.pi)
                there = q + rng.uniform(0.0, reach) * np.array([np.cos(angle), np.sin(angle)])
                near, turned, _ = shape.planar_jet(there)
                assert near < 0.0 or np.allclose(turned, gradient)


@pytest.mark.parametrize("shape", BOUNDED, ids=named)
def test_it_is_drawn_where_h_is_zero_and_within_its_bounds(shape):
    corners = corners_of(shape)
    np.testing.assert_allclose([shape.planar_jet(q)[0] for q in corners], 0.0, atol=1e-9)
    edges = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edges, -1, axis=0)
    assert (edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0] > 0.0).all()
    low_x, low_y, high_x, high_y = _core.shape_bounds(*block_of(shape))
    assert (corners >= np.array([low_x, low_y]) - 1e-9).all()
    assert (corners <= np.array([high_x, high_y]) + 1e-9).all()


@pytest.mark.parametrize("shape", BOUNDED, ids=named)
def test_moved_and_resized_it_is_the_same_elsewhere_and_larger(shape):
    step, larger = np.array([0.7, -0.3]), shape.resized(2.0 * shape.size)
    assert larger.size == pytest.approx(2.0 * shape.size)
    np.testing.assert_allclose(larger.anchor, shape.anchor)
    for q in points(20):
        h = shape.planar_jet(q)[0]
        assert shape.moved(step).planar_jet(q + step)[0] == pytest.approx(h)
        away = shape.anchor + 2.0 * (q - shape.anchor)
        assert larger.planar_jet(away)[0] == pytest.approx(2.0 * h)


@pytest.mark.parametrize("shape", ALL, ids=named)
def test_it_travels_through_json_and_stands_in_arrays(shape):
    assert barriers.from_dict(json.loads(json.dumps(barriers.to_dict(shape)))) == shape
    inherited = {field.name for field in dataclasses.fields(Barrier)} | {"velocity"}
    own = [getattr(shape, f.name) for f in dataclasses.fields(shape) if f.name not in inherited]
    numbers = np.concatenate([np.ravel(value) for value in own])
    values = np.array([own[0]] * 3) if np.ndim(own[0]) == 2 else np.array([numbers] * 3)
    many = Shapes("many", 1, shape.kind, values, velocity=(0.1, 0.2))
    code, block = block_of(shape)
    block[[layout.VELOCITY_X, layout.VELOCITY_Y]] = 0.1, 0.2
    assert many.kind == code
    np.testing.assert_allclose(many.parameters, [block] * 3)
    with pytest.raises(InvalidInputError, match="expected"):
        Shapes("many", 1, shape.kind, np.where(np.isfinite(values), np.nan, values))
