"""`safety_filter`: check_grads, vmap, jit, and the same answers as without JAX."""

import sys

import numpy as np
import pytest
from central_differences import BARRIERS, arrays
from needs import remedy

from hcbf_gym.errors import InvalidInputError, MissingDependencyError
from hcbf_gym.layers.flat import FlatFilter

jax = pytest.importorskip("jax", reason=remedy("jax"))
from jax.test_util import check_grads  # noqa: E402

from hcbf_gym.layers.jax import safety_filter  # noqa: E402


@pytest.fixture(autouse=True)
def _in_64_bit():
    with jax.enable_x64(True):
        yield


@pytest.mark.parametrize("settings", [{}, {"period": 0.05}, {"program": "r-cbf-qp"}], ids=str)
def test_check_grads_in_all_that_u_is_a_function_of(settings):
    function, blocks = safety_filter(BARRIERS, **settings), FlatFilter(BARRIERS).blocks
    given = (*arrays(), blocks, np.full((3, 3), 0.01))
    check_grads(lambda *a: function(*a).u, given, order=1, modes=["rev"])
    check_grads(jax.jit(lambda *a: function(*a).u), given, order=1, modes=["rev"])


def test_batch_vmap_and_jit_agree_bit_for_bit():
    function, (u_nominal, x) = safety_filter(BARRIERS), arrays()

    def slope(u, state):
        return jax.grad(lambda *a: function(*a).u.sum(), argnums=(0, 1))(u, state)

    flat = FlatFilter(BARRIERS)
    own = np.concatenate([flat.blocks, np.zeros((3, 3))], 1).ravel()
    v, t = np.hstack([u_nominal, x, np.tile(own, (6, 1))]), np.zeros(6)
    batch = function(u_nominal, x)
    for one, expected in zip(batch, flat.filter(v, t), strict=True):
        np.testing.assert_array_equal(one, expected)
    for of_one in (jax.vmap(function), jax.jit(jax.vmap(function)), jax.jit(function)):
        for one, expected in zip(of_one(u_nominal, x), batch, strict=True):
            np.testing.assert_array_equal(one, expected)
    pulled = flat.pull_back(v, t, np.ones((6, 2)))
    for of_one in (slope, jax.jit(slope), jax.vmap(slope), jax.jit(jax.vmap(slope))):
        for one, expected in zip(
            of_one(u_nominal, x), (pulled[:, :2], pulled[:, 2:6]), strict=True
        ):
            np.testing.assert_array_equal(one, expected)


def test_vmap_goes_over_scenes_too():
    function, (u_nominal, x) = safety_filter(BARRIERS), arrays()
    blocks = np.tile(FlatFilter(BARRIERS).blocks, (6, 1, 1))
    blocks[:, 1, 4] = np.linspace(0.5, 1.5, 6)  # radii
    many = jax.vmap(function)(u_nominal, x, blocks)
    np.testing.assert_array_equal(many.u[3], function(u_nominal[3], x[3], blocks[3]).u)


def test_wrong_shapes_are_refused():
    function, (u_nominal, x) = safety_filter(BARRIERS), arrays()
    with pytest.raises(InvalidInputError, match=r"x: got shape \(6, 3\), expected \(\.\.\., 4\)"):
        function(u_nominal, x[:, :3])
    with pytest.raises(InvalidInputError, match="expected leading axes that broadcast"):
        function(u_nominal, x, t=np.zeros(5))


def test_32_bit_comes_back_where_jax_is_set_to_it():
    with jax.enable_x64(False):
        u = safety_filter(BARRIERS)(*arrays()).u
    assert u.dtype == np.float32
    np.testing.assert_allclose(u, safety_filter(BARRIERS)(*arrays()).u, rtol=1e-4, atol=1e-4)


def test_a_missing_jax_is_named_with_its_install_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(MissingDependencyError, match=r"pip install .*\[jax\]"):
        safety_filter(BARRIERS)
