"""JAX, the extra `jax`: imported when it is needed, in 64 bit without touching global settings."""

import os
import sys
from collections.abc import Callable
from typing import Any

from hcbf_gym.errors import InvalidInputError, MissingDependencyError, install

_ran_in: int | None = None  # the process in which this package first ran JAX


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
        raise MissingDependencyError(
            f"{what}: got no jax, expected the extra jax: {install('jax')}"
        ) from error
    return jax


def is_jax(value: object) -> bool:
    """Return whether `value` is an array that JAX made."""
    jax = sys.modules.get("jax")
    made = jax is not None and isinstance(value, jax.Array)
    if made:
        _note_process()
    return made


def compile64(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return `function` compiled by JAX in 64 bit, whatever the user's own precision is."""
    return run64(import_jax("compilation").jit(function))


def run64(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return `function` run by JAX in 64 bit, one operation after the other.

    Raises:
        InvalidInputError: when called in a process that was forked from one in which JAX ran.
    """
    enable = import_jax("compilation").enable_x64

    def call(*arguments: Any) -> Any:
        _note_process()
        with enable(True):
            return function(*arguments)

    return call


def _note_process() -> None:
    """Refuse to run JAX in a fork of a process in which it ran: its threads are not copied."""
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
