"""Functions, modules and networks that a user names on a command line or in a contract."""

import functools
import importlib
import importlib.util
import inspect
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from hcbf_gym import opened, sources
from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, in_words, require, text

EXTRA = "walkers"  # the extra that installs onnxruntime


def is_function(name: str) -> bool:
    """Return whether a name is of the form ``module:function`` or ``file.py:function``."""
    return ":" in text("name", name)


def function(what: str, name: str) -> Callable[..., Any]:
    """Return the function or class that a name refers to.

    Its imports are also searched in the folder of the file, or in the current folder of a module.

    Args:
        what: what the function is for, in messages: "policy", "environment", …
        name: ``module:function`` or ``file.py:function``.

    Raises:
        InvalidInputError: if there is no such function, or its module raises an error.
    """
    source, _, attribute = name.rpartition(":")
    expected = "expected module:function or file.py:function"
    if not source or not attribute:
        raise InvalidInputError(f"{what}: got {name!r}, {expected}")
    try:
        named = getattr(_module(source), attribute)
    except Exception as error:  # a user's module raises anything while it is imported
        raise InvalidInputError(f"{what}: got {name!r} ({in_words(error)}), {expected}") from error
    if not callable(named):
        raise InvalidInputError(f"{what}: got {name!r}, which is {named!r}, expected a function")
    return named


def files(name: str) -> list[Path]:
    """Return the file of a named function and the files that it imports, see `sources.of_user`."""
    source = name.rpartition(":")[0]
    if source.endswith(".py"):
        return sources.of_user(Path(source).resolve())
    try:
        origin = inspect.getsourcefile(_module(source))
    except (ImportError, TypeError):  # there is no such module, or it is built in
        origin = None
    return [] if origin is None else sources.of_user(Path(origin))


def module(what: str, source: str) -> ModuleType:
    """Return the module of a name or of ``file.py``; messages call its purpose `what`.

    Raises:
        InvalidInputError: if there is no such module, or it raises an error.
    """
    try:
        return _module(source)
    except Exception as error:  # a user's module raises anything while it is imported
        raise InvalidInputError(
            f"{what}: got {source!r} ({in_words(error)}), expected a file or module "
            "that can be imported"
        ) from error


_opened: dict[ModuleType, dict[str, str]] = {}
"""Module → the files that it read when it was first imported, because they decide its results."""


def _module(source: str) -> ModuleType:
    """Return a module, and record the files that it read when it was imported first."""
    with opened.recorded() as read:
        module = _imported(source)
    opened.note(_opened.setdefault(module, read))
    return module


def _imported(source: str) -> ModuleType:
    """Return the module of a name, searched in the current folder too, or of a file."""
    if not source.endswith(".py"):
        folder = str(Path.cwd())
        if folder not in sys.path:
            sys.path.append(folder)
        return importlib.import_module(source)
    file = Path(source).resolve()
    if not file.is_file():
        raise ImportError(f"no file {source}")
    return _of_file(file, file.stat().st_mtime_ns)


@functools.cache
def _of_file(file: Path, modified: int) -> ModuleType:
    """Return the module of a file, which is imported anew if it was modified since [ns]."""
    if str(file.parent) not in sys.path:
        sys.path.insert(0, str(file.parent))  # as Python does for a script
    name = f"hcbf_own_{file.stem}_{zlib.crc32(str(file).encode()):08x}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


class Network:
    """A feed-forward policy from an ONNX file, run by onnxruntime on one core.

    Args:
        path: the file.
        sizes: n, the size of the observation, and k, the size of the action.

    Raises:
        MissingDependencyError: if onnxruntime is missing.
        InvalidInputError: if there is no such file, onnxruntime refuses it, or its sizes differ.
    """

    def __init__(self, path: Path, sizes: tuple[int, int]):
        require(f"policy {path.name}", EXTRA, "onnxruntime")
        if not path.is_file():
            raise InvalidInputError(f"policy: got {str(path)!r}, expected an existing ONNX file")
        session = _session(path, path.stat().st_mtime_ns)
        inputs, outputs = session.get_inputs(), session.get_outputs()
        n, k = sizes
        if len(inputs) != 1:
            raise InvalidInputError(
                f"policy: got the inputs {[i.name for i in inputs]} in {path.name}, expected one: "
                "the observation"
            )
        if not (_fits(inputs[0].shape, n) and inputs[0].type == "tensor(float)"):
            raise InvalidInputError(
                f"policy: got the input {inputs[0].shape} of {inputs[0].type} in {path.name}, "
                f"expected [1, {n}] of tensor(float), the size of the observation"
            )
        if not _fits(outputs[0].shape, k):
            raise InvalidInputError(
                f"policy: got the output {outputs[0].shape} in {path.name}, expected [1, {k}], the "
                "size of the action"
            )
        self._input = np.zeros((1, n), dtype=np.float32)
        self._feed, self._output = {inputs[0].name: self._input}, [outputs[0].name]
        self._run = session.run

    def __call__(self, observation: Array) -> Array:
        """Return the action (k,) for an observation (n,)."""
        self._input[0] = observation
        return self._run(self._output, self._feed)[0][0]


def _fits(shape: list[int | str | None], size: int) -> bool:
    """Return whether a network's shape is (1, size); None and names fit any size."""
    return len(shape) == 2 and all(
        isinstance(got, str | None) or got == expected
        for got, expected in zip(shape, (1, size), strict=True)
    )


@functools.cache
def _session(path: Path, modified: int) -> Any:
    """Return onnxruntime's session of a file, which all share until it is modified [ns]."""
    onnxruntime: Any = importlib.import_module("onnxruntime")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors share no base class
        raise InvalidInputError(f"policy: onnxruntime refuses {path.name}: {error}") from error
