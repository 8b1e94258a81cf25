"""JAX, the extra `jax`: imported when it is needed, in 64 bit without touching global settings."""

import sys
from collections.abc import Callable
from typing import Any

from hcbf_gym.errors import MissingDependencyError


def import_jax(what: str) -> Any:
    """Return the module jax.

    Args:
        what: what needs it, for the message.

    Raises:
        MissingDependencyError: if it is not installed.
    """
    try:
        import jax
    except ImportError as error:
        raise MissingDependencyError(f"{what} needs JAX: pip install 'hcbf-gym[jax]'") from error
    return jax


def is_jax(value: Any) -> bool:
    """Tell whether `value` is an array that JAX made."""
    jax = sys.modules.get("jax")
    return jax is not None and isinstance(value, jax.Array)


def compile64(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return `function` compiled by JAX in 64 bit, whatever the user's own precision is."""
    jax = import_jax("compilation")
    compiled, enable = jax.jit(function), jax.enable_x64

    def call(*arguments: Any) -> Any:
        with enable(True):
            return compiled(*arguments)

    return call
