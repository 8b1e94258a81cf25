"""A walker's own controller: a network in an ONNX file, or a function of the user's."""

import importlib
import importlib.util
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import mujoco
import numpy as np

from hcbf_gym import compilation
from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, RobotModelError, require

EXTRA = "walkers"


class Controller(Protocol):
    """What turns an observation into an action; one is made for every episode."""

    def __call__(self, observation: Array) -> Array:
        """Return (k,) the action.

        Args:
            observation: (n,) as the contract lists it; the caller writes the next one there.
        """
        ...


Maker = Callable[[mujoco.MjModel, float], Controller]
"""(the compiled scene, the controller's period [s]) → a controller for one episode."""


def is_network(policy: str) -> bool:
    """Return whether a contract's policy is a file rather than ``module:function``."""
    return policy.endswith(".onnx")


def make(policy: str, folder: Path, sizes: tuple[int, int]) -> Maker:
    """Return what makes a controller for an episode.

    Args:
        policy: path to an ONNX file, or ``module:function`` with a `Maker`.
        folder: from which a relative path counts.
        sizes: n of the observation and k of the action.

    Raises:
        MissingDependencyError: if the network needs the extra `walkers`.
        RobotModelError: if the network has other shapes.
        InvalidInputError: if there is no such file, module or function.
    """
    if is_network(policy):
        network = Network(folder / policy, sizes)
        return lambda model, period: network
    return function(policy)


def files(policy: str, folder: Path) -> list[Path]:
    """Return the files of a controller: its network, or its module with what of it is no package's.

    Args:
        policy: as `make` takes it.
        folder: from which a relative path counts.
    """
    if is_network(policy):
        return [folder / policy]
    found = importlib.util.find_spec(policy.partition(":")[0])
    if found is None or found.origin is None:
        return []
    reached = compilation.reached([Path(found.origin)])
    return [file for file in reached if not file.is_relative_to(compilation.PACKAGE)]


class Network:
    """An ONNX network without memory, run by onnxruntime on one core.

    Args:
        path: of the file.
        sizes: n of the observation and k of the action.

    Raises:
        MissingDependencyError: if onnxruntime is missing.
        RobotModelError: if there is no such file, onnxruntime refuses it, or shapes differ.
    """

    def __init__(self, path: Path, sizes: tuple[int, int]):
        require(f"policy {path.name}", EXTRA, "onnxruntime")
        if not path.is_file():
            raise RobotModelError(f"policy: got {str(path)!r}, expected an existing ONNX file")
        session = _session(path, path.stat().st_mtime_ns)
        inputs, outputs = session.get_inputs(), session.get_outputs()
        if len(inputs) != 1:
            raise RobotModelError(
                f"policy: got the inputs {[i.name for i in inputs]} in {path.name}, expected one: "
                "the observation"
            )
        n, k = sizes
        if not (_fits(inputs[0].shape, n) and inputs[0].type == "tensor(float)"):
            raise RobotModelError(
                f"policy: got the input {inputs[0].shape} of {inputs[0].type} in {path.name}, "
                f"expected [1, {n}] of tensor(float), the sizes of the observation's terms"
            )
        if not _fits(outputs[0].shape, k):
            raise RobotModelError(
                f"policy: got the output {outputs[0].shape} in {path.name}, expected [1, {k}], one "
                "for each actuator"
            )
        self._input = np.zeros((1, n), dtype=np.float32)
        self._feed, self._wanted = {inputs[0].name: self._input}, [outputs[0].name]
        self._run = session.run

    def __call__(self, observation: Array) -> Array:
        """Return (k,) the network's output."""
        self._input[0] = observation
        return self._run(self._wanted, self._feed)[0][0]


def _fits(shape: Sequence[object], size: int) -> bool:
    """Return whether a network's shape is (1, size); names stand for any size."""
    return (
        len(shape) == 2
        and shape[0] in (1, None, *filter(_is_name, shape[:1]))
        and shape[1] in (size, None, *filter(_is_name, shape[1:]))
    )


def _is_name(size: object) -> bool:
    return isinstance(size, str)


@cache
def _session(path: Path, changed: int) -> Any:
    """Return onnxruntime's session of a file as it is; one serves all environments."""
    onnxruntime: Any = importlib.import_module("onnxruntime")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime has a family of its own
        raise RobotModelError(f"policy: onnxruntime refuses {path.name}: {error}") from error


def function(name: str) -> Any:
    """Return the function that ``module:function`` names.

    Raises:
        InvalidInputError: if there is none.
    """
    module, _, attribute = name.partition(":")
    if not module or not attribute:
        raise InvalidInputError(
            f"policy: got {name!r}, expected a path that ends in .onnx, or 'module:function'"
        )
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise InvalidInputError(
            f"policy: got {name!r} ({error}), expected a function that is there"
        ) from error
    if not callable(found):
        raise InvalidInputError(f"policy: got {name!r}, expected a function (model, period)")
    return found
