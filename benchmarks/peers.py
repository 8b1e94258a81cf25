"""What others offer for the same job, as calls to be timed; needs the extra `benchmark`.

cbfpy runs at its best: ElastiQP solves, which its README calls much faster than qpax on a CPU, to
the tolerance that it requires, in 64 bit, with one thread each for Eigen and BLAS. JAX reads that
before its first computation, so this module is imported before anything uses JAX.
"""

import importlib
import os
from collections.abc import Callable, Sequence
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Disc, HalfPlane

ENVIRONMENT = {
    "JAX_ENABLE_X64": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
    "OPENBLAS_NUM_THREADS": "1",
}
JAX = {"jax_enable_x64": True, "jax_cpu_enable_async_dispatch": False}
OPTIONS: dict[str, Any] = {"relax_qp": True, "backend": "elastiqp", "solver_tol": 1e-6}

os.environ |= ENVIRONMENT

# by name, so that the types check where they are not installed
cbfpy: Any = importlib.import_module("cbfpy")
jax: Any = importlib.import_module("jax")
for _name, _value in JAX.items():
    jax.config.update(_name, _value)  # where JAX had been imported before
jnp: Any = importlib.import_module("jax.numpy")

Shape = Disc | HalfPlane

TWO_DISCS = (Disc("a", 1, (1.2, 0.1), 1.0), Disc("b", 1, (-0.9, 0.8), 0.8))
MOVING, WANTED = np.array([0.0, 0.0, 0.5, -0.2]), np.array([2.0, 1.0])


def settings() -> dict[str, Any]:
    """Return the versions and the settings that cbfpy runs with."""
    packages = ("cbfpy", "elastiqp", "jax", "numpy")
    return {
        "versions": {name: version(name) for name in packages},
        "options": OPTIONS,
        "environment": ENVIRONMENT,
        "jax": JAX,
    }


class _Shapes(cbfpy.CBFConfig):
    """cbfpy's double integrator among shapes, |u_i| ≤ 5, and ``α(h) = gain · h``, twice.

    It knows no ranks: every row may be violated at its usual price.
    """

    def __init__(self, shapes: Sequence[Any], gain: float = 1.0) -> None:
        self.gain = gain
        discs = [shape for shape in shapes if isinstance(shape, Disc)]
        planes = [shape for shape in shapes if isinstance(shape, HalfPlane)]
        self.centers = np.array([disc.center for disc in discs]).reshape(-1, 2)
        self.radii = np.array([disc.radius for disc in discs])
        self.normals = np.array([plane.normal for plane in planes]).reshape(-1, 2)
        self.offsets = np.array([plane.offset for plane in planes])
        super().__init__(n=4, m=2, u_min=[-5.0, -5.0], u_max=[5.0, 5.0], **OPTIONS)

    def f(self, z: Any) -> Any:
        return jnp.array([z[2], z[3], 0.0, 0.0])

    def g(self, z: Any) -> Any:
        return jnp.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])

    def alpha(self, h: Any) -> Any:
        return self.gain * h

    def alpha_2(self, h_2: Any) -> Any:
        return self.gain * h_2

    def h_2(self, z: Any) -> Any:
        discs = jnp.linalg.norm(z[:2] - self.centers, axis=1) - self.radii
        if not self.offsets.size:
            return discs
        return jnp.concatenate((self.normals @ z[:2] - self.offsets, discs))


def cbfpy_filter(
    shapes: Sequence[Shape] = TWO_DISCS, x: Array = MOVING, u_nominal: Array = WANTED
) -> Callable[[], Array]:
    """Return a call of cbfpy's compiled `safety_filter`, NumPy in and out."""
    cbf = cbfpy.CBF.from_config(_Shapes(shapes))
    return lambda: np.asarray(cbf.safety_filter(x, u_nominal))


@cache
def cbfpy_batch(
    shapes: tuple[Any, ...], gain: float
) -> tuple[Callable[[Array, Array], Array], Callable[[Array], Array]]:
    """Return cbfpy's filter of N states, and (N, 4) → its h and ψ = ḣ + gain·h (2, N, k)."""
    config = _Shapes(shapes, gain)
    cbf = cbfpy.CBF.from_config(config)
    many = jax.jit(jax.vmap(cbf.safety_filter))

    @jax.jit
    @jax.vmap
    def psi(z: Any) -> Any:
        h, slope = jax.jvp(config.h_2, (z,), (config.f(z),))
        return h, slope + gain * h

    return lambda x, u: np.asarray(many(x, u)), lambda x: np.asarray(psi(x))
