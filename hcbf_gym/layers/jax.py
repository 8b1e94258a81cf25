"""The safety filter as a function for JAX, the extra ``jax``."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hcbf_gym.barriers.many import Element
from hcbf_gym.layers.flat import Filtered, FlatFilter
from hcbf_gym.models.autodiff import import_jax


def safety_filter(barriers: Sequence[Element], **settings: Any) -> Callable[..., Filtered]:
    """Return u as a differentiable function of u*, the state, the barriers' numbers and margins.

    The function is ``filter(u_nominal, x, blocks=None, margin=None, t=0.0)``, with arrays and
    answer as those of `layers.torch.SafetyLayer`. It works under `jit`, `vmap` and reverse-mode
    differentiation of the first order, and calls the host, which computes in 64 bit; its answer is
    as precise as JAX is set to be (``jax.config.update("jax_enable_x64", True)``).

    Args:
        barriers: m of them, of built-in kinds, in order.
        settings: `input_set`, `program`, `alpha1`, `alpha2`, `alpha_speed`, `period` and the
            program's options, see `layers.flat.FlatFilter`.

    Raises:
        InvalidInputError: on other barriers or malformed settings.
        UnknownNameError: on an unknown program; the message lists the choices.
        MissingDependencyError: if JAX is not installed.
    """
    jax = import_jax("safety_filter")
    jnp, flat = jax.numpy, FlatFilter(barriers, **settings)

    def on_host(variables: Any, t: Any) -> tuple[Any, Any, Any]:
        u, status, degenerate = flat.filter(np.asarray(variables), np.asarray(t))
        return u.astype(variables.dtype), status.astype(np.int32), degenerate

    def pulled_on_host(variables: Any, t: Any, w: Any) -> Any:
        pulled = flat.pull_back(np.asarray(variables), np.asarray(t), np.asarray(w))
        return pulled.astype(variables.dtype)

    @jax.custom_vjp
    def solve(variables: Any, t: Any) -> Any:
        batch = variables.shape[:-1]
        answer = (
            jax.ShapeDtypeStruct((*batch, 2), variables.dtype),
            jax.ShapeDtypeStruct(batch, np.int32),
            jax.ShapeDtypeStruct(batch, np.bool_),
        )
        return jax.pure_callback(on_host, answer, variables, t, vmap_method="broadcast_all")

    def backward(kept: Any, cotangents: Any) -> Any:
        variables, t = kept
        like = jax.ShapeDtypeStruct(variables.shape, variables.dtype)
        pulled = jax.pure_callback(
            pulled_on_host, like, variables, t, cotangents[0], vmap_method="broadcast_all"
        )
        return pulled, jnp.zeros_like(t)

    solve.defvjp(lambda variables, t: (solve(variables, t), (variables, t)), backward)

    def call(
        u_nominal: Any, x: Any, blocks: Any = None, margin: Any = None, t: Any = 0.0
    ) -> Filtered:
        numbers = flat.blocks if blocks is None else blocks
        zero = np.zeros((len(flat.blocks), 3)) if margin is None else margin
        arrays = [jnp.asarray(one, dtype=float) for one in (u_nominal, x, numbers, zero, t)]
        variables, times = flat.variables(jnp, *arrays)
        return Filtered(*solve(variables, jax.lax.stop_gradient(times)))

    return call
