"""The safety filter as a function for JAX, the extra ``jax``."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from hcbf_gym.barriers.many import Element
from hcbf_gym.layers.flat import MARGIN_SIZE, Filtered, FlatFilter
from hcbf_gym.models.autodiff import import_jax

JaxArray = Any  # `jax.Array`: JAX is imported when a filter is made, not before


def safety_filter(barriers: Sequence[Element], **settings: Any) -> Callable[..., Filtered]:
    """Return u as a differentiable function of u*, the state, the barriers' numbers and margins.

    The function is ``filter(u_nominal, x, blocks=None, margin=None, t=0.0)``. Its arguments and its
    result have the shapes of `layers.torch.SafetyLayer.forward`. It works under `jit`, `vmap` and
    reverse-mode differentiation of the first order. It calls the host, which computes in 64 bit.
    The result has JAX's own precision (``jax.config.update("jax_enable_x64", True)``).

    Args:
        barriers: m barriers of built-in kinds.
        settings: the other arguments of `layers.flat.FlatFilter`: `input_set`, `program`, `alpha1`,
            `alpha2`, `alpha_speed`, `period`, and the program's options.

    Raises:
        InvalidInputError: on a barrier of another kind, or malformed settings.
        UnknownNameError: on an unknown program; the message lists the choices.
        MissingDependencyError: if JAX is not installed.
    """
    jax, flat = import_jax("safety_filter"), FlatFilter(barriers, **settings)
    solve = _solver(jax, flat)

    def filtered(
        u_nominal: Any, x: Any, blocks: Any = None, margin: Any = None, t: Any = 0.0
    ) -> Filtered:
        blocks = flat.blocks if blocks is None else blocks
        margin = np.zeros((len(flat.blocks), MARGIN_SIZE)) if margin is None else margin
        arguments = (u_nominal, x, blocks, margin, t)
        arrays = [jax.numpy.asarray(argument, dtype=float) for argument in arguments]
        variables, times = flat.variables(jax.numpy, *arrays)
        return Filtered(*solve(variables, jax.lax.stop_gradient(times)))

    return filtered


def _solver(jax: Any, flat: FlatFilter) -> Callable[[JaxArray, JaxArray], JaxArray]:
    """Return the filter as JAX's function of variables (…, K) and times (…,), with its derivative.

    JAX cannot trace compiled code. So the function and its derivative call the host, once a batch.
    """

    @jax.custom_vjp
    def solve(variables: JaxArray, t: JaxArray) -> JaxArray:
        batch = variables.shape[:-1]
        result = (
            jax.ShapeDtypeStruct((*batch, 2), variables.dtype),  # u
            jax.ShapeDtypeStruct(batch, np.int32),  # the statuses
            jax.ShapeDtypeStruct(batch, np.bool_),  # where u has no derivative
        )
        host = partial(_filter_on_host, flat)
        return jax.pure_callback(host, result, variables, t, vmap_method="broadcast_all")

    def forward(variables: JaxArray, t: JaxArray) -> tuple[JaxArray, tuple[JaxArray, JaxArray]]:
        return solve(variables, t), (variables, t)

    def backward(residuals: tuple[JaxArray, JaxArray], cotangents: JaxArray) -> JaxArray:
        variables, t = residuals
        w = cotangents[0]  # (…, 2) of u: the other results have no derivatives
        result = jax.ShapeDtypeStruct(variables.shape, variables.dtype)
        host = partial(_pull_back_on_host, flat)
        product = jax.pure_callback(host, result, variables, t, w, vmap_method="broadcast_all")
        return product, jax.numpy.zeros_like(t)

    solve.defvjp(forward, backward)
    return solve


def _filter_on_host(flat: FlatFilter, variables: JaxArray, t: JaxArray) -> tuple[Any, Any, Any]:
    """Return u (…, 2) in JAX's precision, statuses (…,) and where u has no derivative (…,)."""
    u, status, degenerate = flat.filter(np.asarray(variables), np.asarray(t))
    return u.astype(variables.dtype), status.astype(np.int32), degenerate


def _pull_back_on_host(flat: FlatFilter, variables: JaxArray, t: JaxArray, w: JaxArray) -> Any:
    """Return (∂u/∂variables)ᵀ w (…, K), in JAX's precision."""
    product = flat.pull_back(np.asarray(variables), np.asarray(t), np.asarray(w))
    return product.astype(variables.dtype)
