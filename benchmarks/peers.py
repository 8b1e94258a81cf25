"""What others offer for the same job, as calls to be timed; needs the extra `benchmark`.

They run with what cbfpy's README recommends: 64 bit, and one thread each for Eigen and BLAS. JAX
reads that before its first computation, so this module is imported before anything uses JAX.
"""

import importlib
import os
from collections.abc import Callable
from typing import Any

import numpy as np

os.environ |= {
    "JAX_ENABLE_X64": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
    "OPENBLAS_NUM_THREADS": "1",
}

# by name, so that the types check where they are not installed
cbfpy: Any = importlib.import_module("cbfpy")
jax: Any = importlib.import_module("jax")
jax.config.update("jax_enable_x64", True)  # where JAX had been imported before
jnp: Any = importlib.import_module("jax.numpy")
qpax: Any = importlib.import_module("qpax")


class _TwoDiscs(cbfpy.CBFConfig):
    """cbfpy's double integrator between two discs, |u_i| ≤ 5."""

    def __init__(self) -> None:
        super().__init__(n=4, m=2, u_min=[-5.0, -5.0], u_max=[5.0, 5.0])

    def f(self, z: Any) -> Any:
        return jnp.array([z[2], z[3], 0.0, 0.0])

    def g(self, z: Any) -> Any:
        return jnp.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])

    def h_2(self, z: Any) -> Any:
        centers, radii = jnp.array([[1.2, 0.1], [-0.9, 0.8]]), jnp.array([1.0, 0.8])
        return jnp.linalg.norm(z[:2] - centers, axis=1) - radii


def cbfpy_filter() -> Callable[[], Any]:
    """Return a call of cbfpy's compiled `safety_filter`, NumPy in and out."""
    cbf = cbfpy.CBF.from_config(_TwoDiscs())
    z, u = np.array([0.0, 0.0, 0.5, -0.2]), np.array([2.0, 1.0])
    return lambda: np.asarray(cbf.safety_filter(z, u))


def qpax_batch(count: int) -> Callable[[], Any]:
    """Return a call that solves `count` H-CBF-QPs with one relaxed row by qpax under vmap.

    The variables are (u, δ); rows are given, û is not computed.
    """
    rng = np.random.default_rng(0)
    hessian = jnp.diag(jnp.array([1.0, 1.0, 5.0]))
    box = np.hstack((np.vstack((np.eye(2), -np.eye(2))), np.zeros((4, 1))))

    def solve(u: Any, a: Any, b: Any, target: Any) -> Any:
        linear = jnp.concatenate((-u, jnp.zeros(1)))
        strict = jnp.hstack((-a[:3], jnp.zeros((3, 1))))
        inequalities, bounds = jnp.vstack((box, strict)), jnp.concatenate((jnp.full(4, 5.0), -b))
        equality = jnp.concatenate((a[3], jnp.ones(1)))[None]
        return qpax.solve_qp_primal(hessian, linear, equality, target[None], inequalities, bounds)

    batch = jax.jit(jax.vmap(solve))
    data = (
        jnp.array(rng.normal(0.0, 3.0, (count, 2))),
        jnp.array(rng.normal(0.0, 1.0, (count, 4, 2))),
        jnp.array(rng.normal(-2.0, 1.0, (count, 3))),
        jnp.array(rng.normal(0.0, 1.0, count)),
    )
    return lambda: jax.block_until_ready(batch(*data))
