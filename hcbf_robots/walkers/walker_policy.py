"""A walker's own controller: a network in an ONNX file, or a function of the user's."""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import mujoco

from hcbf_gym import loading
from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, RobotModelError


class Controller(Protocol):
    """What turns an observation into an action; one is made for every episode."""

    def __call__(self, observation: Array) -> Array:
        """Return (k,) the action."""
        ...


Maker = Callable[[mujoco.MjModel, float], Controller]
"""(the compiled scene, the controller's period [s]) → a controller for one episode."""


def make(policy: str, folder: Path, sizes: tuple[int, int]) -> Maker:
    """Return what makes a controller for an episode.

    Args:
        policy: path to an ONNX file, or ``module:function`` or ``file.py:function`` with a `Maker`.
        folder: from which a relative path counts.
        sizes: n of the observation and k of the action.

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
    return loading.function("policy", _beside(policy, folder))


def files(policy: str, folder: Path) -> list[Path]:
    """Return the files of a controller: its network, or its module's; arguments as `make` has."""
    if policy.endswith(".onnx"):
        return [folder / policy]
    return loading.files(_beside(policy, folder))


def _beside(policy: str, folder: Path) -> str:
    """Return a function's name, whose file counts from a folder."""
    return str(folder / policy) if policy.partition(":")[0].endswith(".py") else policy
