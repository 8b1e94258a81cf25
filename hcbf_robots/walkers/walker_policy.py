"""Loads a walker's controller: a network in an ONNX file, or a user's function."""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import mujoco

from hcbf_gym import loading
from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, RobotModelError


class Controller(Protocol):
    """Turns an observation into an action, throughout one episode."""

    def __call__(self, observation: Array) -> Array:
        """Return the action (k,) for an observation (n,)."""
        ...


Maker = Callable[[mujoco.MjModel, float], Controller]
"""Returns a controller for one episode, from the compiled scene and the controller's period [s]."""


def make(policy: str, folder: Path, sizes: tuple[int, int]) -> Maker:
    """Return the function that makes a controller for each episode.

    Args:
        policy: path to an ONNX file, or the name of a `Maker`, ``module:function`` or
            ``file.py:function``.
        folder: the contract's, to which paths are relative.
        sizes: number of entries of the observation (n) and of the action (k).

    Raises:
        MissingDependencyError: if the network needs the extra `walkers`.
        RobotModelError: if there is no such network, or it has other shapes.
        InvalidInputError: if there is no such module, file or function.
    """
    if policy.endswith(".onnx"):
        try:
            network = loading.Network(folder / policy, sizes)
        except InvalidInputError as error:
            raise RobotModelError(str(error)) from error
        return lambda model, period: network
    if not loading.is_function(policy):
        raise InvalidInputError(
            f"policy: got {policy!r}, expected a path that ends in .onnx, module:function or "
            "file.py:function"
        )
    return loading.function("policy", _in_folder(policy, folder))


def files(policy: str, folder: Path) -> list[Path]:
    """Return the file of a controller's network, or the files of a user's module."""
    if policy.endswith(".onnx"):
        return [folder / policy]
    return loading.files(_in_folder(policy, folder))


def _in_folder(policy: str, folder: Path) -> str:
    """Return a function's name, with its file, if it has one, in the folder."""
    return str(folder / policy) if policy.partition(":")[0].endswith(".py") else policy
