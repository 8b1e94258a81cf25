"""The errors and warnings of this package, and the checks of arguments that raise them.

A message states the value that was given, what was expected, and the choices. The functions that
take the `name` of an argument show it in the message. They raise `InvalidInputError` on an invalid
value.
"""

import contextlib
import importlib.util
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")


class HcbfError(Exception):
    """Base of every error that this package raises on purpose."""


class InvalidInputError(HcbfError, ValueError):
    """An argument, a file or an array was refused before anything was changed."""


class UnreachableError(InvalidInputError):
    """No input of a model changes a derivative of a barrier's h that could preserve the barrier."""


class UnknownNameError(InvalidInputError):
    """A name is not registered; the message lists the registered ones."""


class RobotModelError(InvalidInputError):
    """A robot description does not match what the controller drives."""


class SolverError(HcbfError, RuntimeError):
    """A quadratic program that must have a solution was not solved by any solver."""


class JobError(HcbfError, RuntimeError):
    """A job of a long run raised an error, or killed its workers; the message names it."""


class RefusedError(HcbfError, RuntimeError):
    """A plant gets no certificate; the message names the reason."""


class RenderingError(HcbfError, RuntimeError):
    """No OpenGL context could be made; the message names what to install."""


class MissingDependencyError(HcbfError, ImportError):
    """An optional dependency is needed; the message names the extra that brings it."""


MAX_SHOWN = 400  # the number of characters of a value that a message shows at most
MAX_COUNT = 10_000_000  # the largest number that `count` accepts unless it is given another
MAX_NESTING = 64  # how deep lists of numbers may be nested: a NumPy array has no more axes


class CoverageWarning(UserWarning):
    """Rank 1 is not promised for these arguments: they are outside of the tested ranges."""


class LoweredWarning(UserWarning):
    """The cap on the speed is lowered to what the robot can carry."""


class SafetyWarning(UserWarning):
    """The filter brakes, or has detected that the plant differs from the declared one."""


_NOT_THE_USERS = {"hcbf_gym", "hcbf_robots", "hcbf_lab", "gymnasium", "contextlib", "functools"}
"""Packages whose lines no warning points to."""


def warn_caller(text: str, category: type[Warning] = UserWarning) -> None:
    """Warn with the line of the user's code from which this package was called."""
    frame, level = sys._getframe(), 1
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in _NOT_THE_USERS:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)


@contextlib.contextmanager
def warned_once() -> Iterator[None]:
    """Collect the warnings of the block, and repeat each of them once at its end."""
    raised: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            yield
    finally:  # after an error, too: a warning may explain it
        different = dict.fromkeys((str(warning.message), warning.category) for warning in raised)
        for text, category in different:
            warn_caller(text, category)


def choose(kind: str, name: object, choices: Mapping[str, T]) -> T:
    """Return ``choices[name]``; the message of an error calls it a `kind` ("program", …).

    Raises:
        UnknownNameError: if there is no such name; the message lists the names that exist.
    """
    if not isinstance(name, str) or name not in choices:
        raise UnknownNameError(
            f"unknown {kind}: got {shown(name)}, expected one of {sorted(choices)}"
        )
    return choices[name]


def count(name: str, value: object, *, minimum: int = 1, maximum: float = MAX_COUNT) -> int:
    """Return a whole number from `minimum` to `maximum`; truth values are refused."""
    number = minimum - 1  # out of range
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        number = int(value)
    if not minimum <= number <= maximum:
        most = "" if maximum == np.inf else f" and <= {maximum}"
        raise InvalidInputError(
            f"{name}: got {shown(value)}, expected a whole number >= {minimum}{most}"
        )
    return number


def instance(name: str, value: object, *kinds: type[T]) -> T:
    """Return the value, which has to be an instance of one of the classes `kinds`."""
    if not isinstance(value, kinds):
        expected = " or ".join(f"a {kind.__name__}" for kind in kinds)
        raise InvalidInputError(f"{name}: got {shown(value)}, expected {expected}")
    return value


def check_not_overridden(name: str, value: object, *kinds: type) -> None:
    """Refuse an object of a user's subclass whose own methods compiled code would not call.

    Args:
        name: the argument's name, for the message.
        value: an instance of one of `kinds`.
        *kinds: dataclasses that compiled code reads by their numbers.
    """
    if changed := overridden(type(value), *kinds):
        raise InvalidInputError(
            f"{name}: got a {type(value).__name__} with its own {', '.join(changed)}, expected "
            f"{' or '.join(kind.__name__ for kind in kinds)} itself: compiled code reads its "
            "numbers, and calls no method"
        )


def overridden(cls: type, *kinds: Any) -> list[str]:
    """Return the methods of dataclasses `kinds` that a class derived from one has anew."""
    derived = cls.__mro__[: min(cls.__mro__.index(kind) for kind in kinds if kind in cls.__mro__)]
    declared = {field.name for kind in kinds for field in fields(kind)}
    return [
        key
        for base in derived
        for key in vars(base)
        if key == "__call__" or not (key.startswith(("__", "_abc_")) or key in declared)
        if any(hasattr(kind, key) for kind in kinds)
    ]


def flag(name: str, value: object) -> bool:
    """Return a truth value; numbers and text such as "False" are refused."""
    return bool(instance(name, value, bool, np.bool_))


def listed(name: str, value: object, *kinds: type[T]) -> tuple[T, ...]:
    """Return a sequence as a tuple; its entries have to be instances of the classes `kinds`."""
    if not isinstance(value, Sequence) or isinstance(value, str | bytes):
        expected = " or ".join(kind.__name__ for kind in kinds)
        raise InvalidInputError(f"{name}: got {shown(value)}, expected a sequence of {expected}")
    return tuple(instance(name, entry, *kinds) for entry in value)


def text(name: str, value: object) -> str:
    """Return a text or a path as text; a NUL character in it is refused."""
    if not isinstance(value, str | Path) or "\0" in str(value):
        raise InvalidInputError(f"{name}: got {shown(value)}, expected text")
    return str(value)


def require(what: str, extra: str, *modules: str) -> None:
    """Refuse to begin `what` ("hcbf tune", "--video", …) without the modules of an extra.

    Raises:
        MissingDependencyError: if a module is not installed; the message names the extra.
    """
    missing = _missing(modules)
    if missing:
        raise MissingDependencyError(
            f"{what}: got no {', '.join(missing)}, expected the extra {extra}: {install(extra)}"
        )


def _missing(modules: Iterable[str]) -> list[str]:
    """Return the modules that are not installed, without an import of the others."""
    return [name for name in modules if importlib.util.find_spec(name) is None]


def install(extra: str) -> str:
    """Return the commands that install an extra from a checkout; this package is on no index."""
    return (
        f"pip install -c constraints.txt -e '.[{extra}]' in a checkout, "
        f"pip install 'PATH/TO/CHECKOUT[{extra}]' elsewhere"
    )


_REQUIREMENTS = {"mujoco": "mujoco>=3.11", "pinocchio": "pin>=4.0"}  # module → what pip installs


def require_packages(what: str, *modules: str) -> None:
    """Refuse to begin `what` without "mujoco" or "pinocchio", which a light installation lacks.

    Raises:
        MissingDependencyError: if a module is missing; the message has the command to install it.
    """
    missing = _missing(modules)
    if missing:
        requirements = " ".join(f"'{_REQUIREMENTS[name]}'" for name in missing)
        raise MissingDependencyError(
            f"{what}: got no {', '.join(missing)}, expected it: pip install {requirements}"
        )


def check_options(kind: str, options: Iterable[str], allowed: Iterable[str]) -> None:
    """Refuse unknown keyword options of a `kind` ("guidance", …).

    Raises:
        InvalidInputError: if an option is not allowed; the message lists the allowed ones.
    """
    allowed = sorted(allowed)
    unknown = sorted(set(options) - set(allowed))
    if unknown:
        raise InvalidInputError(
            f"{kind}: got unknown option(s) {unknown}, expected among {allowed}"
        )


def in_words(error: Exception) -> str:
    """Return the message of an error, with its class unless it is an error of this package.

    It is the class alone if the error has no text, or raises another one while it is read.
    """
    kind = type(error).__name__
    try:
        text = str(error)
    except Exception:  # a user's own class may raise anything
        text = ""
    if isinstance(error, HcbfError) and text:
        return text
    return f"{kind}: {text}" if text else kind


def shown(value: object) -> str:
    """Return the text of a value for a message; the middle of a long text is left out."""
    try:
        text = repr(value)
    except Exception:  # endless lists and foreign objects raise anything
        text = f"a {type(value).__name__}"
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 60]} … {text[-50:]}"


def reals(name: str, value: object) -> NDArray[np.float64]:
    """Return `value` as a new float64 array of any shape; entries may be NaN or infinite.

    Raises:
        InvalidInputError: on text, truth values, complex numbers, objects, floats of other than 32
            or 64 bits, and ragged lists.
    """
    given = as_array(name, value)
    if isinstance(value, list | tuple):  # an array of them no longer shows what was a truth value
        is_real = _is_real(value) and (given.dtype.kind == "O" or holds_numbers(given.dtype))
    else:
        is_real = holds_numbers(given.dtype)
    try:
        if is_real:
            return np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        pass
    got = given.dtype if isinstance(value, np.ndarray) else shown(value)
    raise InvalidInputError(f"{name}: got {got}, expected real numbers of 32 or 64 bits")


def finite_array(
    name: str, value: object, shape: tuple[int | None, ...], *, largest: float = np.inf
) -> NDArray[np.float64]:
    """Return `value` as a new float64 array with finite entries.

    Args:
        name: the argument's name, for the message.
        value: real numbers, in an array or in lists of them.
        shape: the expected shape, with None for an axis of any length.
        largest: the largest magnitude of an entry.

    Raises:
        InvalidInputError: on what `reals` refuses, another shape, NaN, infinity or larger entries.
    """
    array = reals(name, value)
    has_axes = array.ndim == len(shape)
    if not has_axes or any(n not in (None, got) for n, got in zip(shape, array.shape, strict=True)):
        expected = tuple("any" if n is None else n for n in shape)
        raise InvalidInputError(f"{name}: got shape {array.shape}, expected {expected}")
    if not np.isfinite(array).all():
        raise InvalidInputError(f"{name}: got {shown(array.tolist())}, expected finite numbers")
    if largest < np.inf and (np.abs(array) > largest).any():
        raise InvalidInputError(
            f"{name}: got {shown(array.tolist())}, expected numbers between {-largest} and "
            f"{largest}"
        )
    return array


def floats(name: str, value: object, shape: tuple[int, ...] | None = None) -> NDArray[Any]:
    """Return `value` as an array that retains its 32 or 64 bits; Python's numbers have 64.

    Entries may be NaN or infinite. A shape of None accepts any.

    Raises:
        InvalidInputError: on arrays of integers, half precision, truth values, complex numbers,
            objects, and another shape.
    """
    given = as_array(name, value)
    if isinstance(value, list | tuple | int) and given.dtype.kind in "iu" and _is_real(value):
        given = given.astype(np.float64)
    is_float = given.dtype.kind == "f" and holds_numbers(given.dtype)
    if not is_float or shape not in (None, given.shape):
        raise InvalidInputError(
            f"{name}: got {given.dtype} of shape {given.shape}, expected real numbers, float32 or "
            f"float64, of shape {'any' if shape is None else shape}"
        )
    return given


def as_array(name: str, value: object) -> NDArray[Any]:
    """Return `value` as a NumPy array of any type; a tensor's is a view.

    Raises:
        InvalidInputError: on ragged lists, masked entries, foreign objects without entries, tensors
            that need a gradient, are on another device or have no form in NumPy, and JAX tracers.
    """
    if type(value) is np.ndarray:
        return value
    kind = library_of(value)
    if kind == "torch":
        return _of_torch(name, value)
    if kind == "jax" and isinstance(value, sys.modules["jax"].core.Tracer):
        raise InvalidInputError(
            f"{name}: got {shown(value)}, which JAX traces, expected an array; inside jit call "
            "the filter by jax.pure_callback"
        )
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        raise InvalidInputError(f"{name}: got {shown(value)}, expected an array without a mask")
    try:
        return np.asarray(value)
    except Exception as error:  # a foreign object raises anything
        raise InvalidInputError(f"{name}: got {shown(value)}, expected an array") from error


def library_of(value: object) -> str:
    """Return which library made an array, "torch", "jax" or "numpy"; nothing is imported."""
    torch, jax = sys.modules.get("torch"), sys.modules.get("jax")
    if torch is not None and isinstance(value, torch.Tensor):
        return "torch"
    if jax is not None and isinstance(value, jax.Array):
        return "jax"
    return "numpy"


def _of_torch(name: str, tensor: Any) -> NDArray[Any]:
    """Return a tensor's memory as an array; tensors that have no such view are refused."""
    if tensor.requires_grad:
        raise InvalidInputError(
            f"{name}: got a tensor that needs a gradient, expected one without: {name}.detach(); "
            "the filter is no part of the graph"
        )
    if tensor.device.type != "cpu":
        raise InvalidInputError(
            f"{name}: got a tensor on {tensor.device}, expected one on the CPU: {name}.cpu()"
        )
    try:
        return tensor.numpy()
    except (TypeError, RuntimeError) as error:  # bfloat16, sparse
        raise InvalidInputError(
            f"{name}: got a tensor of {tensor.dtype} and {tensor.layout}, expected a dense one of "
            f"32 or 64 bits: {name}.to_dense().float()"
        ) from error


def holds_numbers(dtype: np.dtype) -> bool:
    """Return whether a type holds integers, or floats of 32 or 64 bits."""
    return dtype.kind in "iu" or (dtype.kind == "f" and dtype.itemsize in (4, 8))


def _is_real(value: object, levels: int = MAX_NESTING) -> bool:
    """Return whether no entry of nested lists is a text, a truth value or a complex number."""
    if isinstance(value, list | tuple):
        return levels > 0 and all(_is_real(entry, levels - 1) for entry in value)
    if isinstance(value, np.ndarray | np.generic):
        return holds_numbers(value.dtype)
    return not isinstance(value, bool | str | bytes | complex)


def finite_float(
    name: str,
    value: object,
    *,
    minimum: float = -np.inf,
    maximum: float = np.inf,
    exclusive: bool = False,
) -> float:
    """Return a finite float from `minimum` to `maximum`; `exclusive` refuses `minimum` itself.

    Truth values and half precision are refused.
    """
    is_number = isinstance(value, int | float | np.integer | np.floating)
    is_half = isinstance(value, np.floating) and not holds_numbers(value.dtype)
    number = np.nan
    if is_number and not (is_half or isinstance(value, bool)):
        with contextlib.suppress(OverflowError):  # an integer beyond the floats
            number = float(value)
    too_low = number <= minimum if exclusive else number < minimum
    if not np.isfinite(number) or too_low or number > maximum:
        bounds = []
        if np.isfinite(minimum):
            bounds.append(f"{'>' if exclusive else '>='} {minimum}")
        if np.isfinite(maximum):
            bounds.append(f"<= {maximum}")
        expected = " and ".join(bounds) or "that is finite"
        raise InvalidInputError(f"{name}: got {shown(value)}, expected a number {expected}")
    return number
