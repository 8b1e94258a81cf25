"""JAX, the extra `jax`: imported when it is used, run in 64 bit without global settings."""

import os
import sys
from collections.abc import Callable
from typing import Any

from hcbf_gym.errors import InvalidInputError, MissingDependencyError, install

_ran_in: int | None = None  # the process in which this package first ran JAX


def import_jax(what: str) -> Any:
    """Return the module jax, for a function that messages call `what`.

    Raises:
        MissingDependencyError: if JAX is not installed.
    """
    try:
        import jax
    except ImportError as error:
        raise MissingDependencyError(
            f"{what}: got no jax, expected the extra jax: {install('jax')}"
        ) from error
    return jax


def is_jax(value: object) -> bool:
    """Return whether `value` is an array that JAX made."""
    jax = sys.modules.get("jax")
    is_array = jax is not None and isinstance(value, jax.Array)
    if is_array:
        _refuse_fork()
    return is_array


def compile64(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return `function` compiled by JAX in 64 bit, independent of the user's precision."""
    return run64(import_jax("compilation").jit(function))


def run64(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return `function` run by JAX in 64 bit without compilation.

    Raises:
        InvalidInputError: when called in a process that was forked from one in which JAX ran.
    """
    enable_x64 = import_jax("compilation").enable_x64

    def call(*arguments: Any) -> Any:
        _refuse_fork()
        with enable_x64(True):
            return function(*arguments)

    return call


def _refuse_fork() -> None:
    """Refuse to run JAX in a fork of a process in which JAX ran: a fork has none of its threads."""
    global _ran_in
    process = os.getpid()
    if _ran_in is None:
        _ran_in = process
    elif _ran_in != process:
        raise InvalidInputError(
            "got JAX in a process that was forked from one in which JAX ran, where it would hang; "
            'expected processes that start anew, such as AsyncVectorEnv(…, context="spawn"), or '
            '"forkserver"'
        )
