"""Identity of objects: a hash of their bytes, dtypes, shapes, fields and functions.

Two objects have the same hash only if every part of them is the same. The hash of a function covers
its bytecode, constants and names, its defaults, its closure, and the globals and helpers that it
reads, but no line numbers or file names. A function or class of an installed package, of Python's
library or of this package is hashed by its name and the package's version.

The hash is the same in another process of the same minor version of Python. It does not depend on
addresses, on the order of sets, or on cached values (`functools.cached_property`).

>>> of({"gain": 1.0}) == of({"gain": 1.0}) != of({"gain": 2.0})
True
"""

import builtins
import collections
import copyreg
import enum
import functools
import hashlib
import importlib
import pickle
import types
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import is_dataclass
from typing import Any

import numpy as np

from hcbf_gym.certificates.introspection import attributes, is_opaque, name_of, reads, release
from hcbf_gym.errors import HcbfError, in_words

NUMBERS = int, float, complex, str, bytes
PLAIN = (*NUMBERS, bool, type(None), type(...), type(NotImplemented))
CONTAINERS = list, tuple, dict, set, frozenset
DESCRIPTORS = (
    types.WrapperDescriptorType, types.MethodDescriptorType, types.ClassMethodDescriptorType,
    types.GetSetDescriptorType, types.MemberDescriptorType,
)  # fmt: skip
NAMED_TUPLE_FIELD = type(collections.namedtuple("_", "x").x)  # type: ignore[attr-defined]
"""The type of the descriptors of a named tuple's fields."""
UNTRACEABLE = ("eval", "exec", "globals", "locals", "__import__")
"""Built-in functions that read objects which the bytecode does not name."""
LONG_LIST = 100  # a list of more floats is hashed in one piece, which is faster


class UnhashableError(HcbfError, TypeError):
    """A part of an object has no bytes that identify it: a lock, a generator, an open file."""


def of(thing: object, name: str = "object") -> str:
    """Return the hash of an object, 20 hexadecimal digits.

    Args:
        thing: any object.
        name: its name in messages.

    Raises:
        UnhashableError: if a part of it cannot be hashed; the message names the part.
    """
    walk = _Walk(name)
    try:
        walk.add(thing)
    except UnhashableError:
        raise
    except Exception as error:  # attributes and pickling run a user's code, which raises anything
        raise UnhashableError(f"{': '.join(walk.path)}: {in_words(error)}") from error
    return walk.hash.hexdigest()[:20]


class _Walk:
    """A walk through an object and its parts, which feeds the hash.

    Numbers, arrays, containers and dataclasses are hashed by their content, however often they
    occur. Functions, classes, modules and other objects are numbered where they first occur, and
    hashed by their number afterwards. So cycles end, and a large program is read once.
    """

    def __init__(self, name: str):
        self.path, self.hash = [name], hashlib.sha256()
        self._number_of: dict[int, int] = {}  # address → number of an object
        self._depth_of: dict[int, int] = {}  # address → depth of a container that is being hashed
        self._alive: list[object] = []  # no address is reused as long as its object is referenced

    @contextmanager
    def _below(self, name: object) -> Iterator[None]:
        """Extend the path, which the message of an error shows, by the name of a part."""
        self.path.append(str(name))
        yield
        self.path.pop()  # not after an error, whose message shows the path

    def _put(self, tag: str, data: Any = b"") -> None:
        """Hash a tag and bytes; the length excludes that other tags and bytes look the same."""
        raw = data if isinstance(data, bytes) else str(data).encode("utf-8", "surrogatepass")
        self.hash.update(f"{tag} {len(raw)} ".encode())
        self.hash.update(raw)

    def _add_parts(self, tag: str, *parts: object) -> None:
        """Hash a tag, the number of parts, and each part."""
        self._put(tag, len(parts))
        for part in parts:
            self.add(part)

    def _add_by_name(self, values: Mapping[str, Any]) -> None:
        """Hash values with their names, in the order of the names."""
        for name in sorted(values):
            with self._below(name):
                self._put("name", name)
                self.add(values[name])

    def add(self, thing: Any) -> None:
        """Hash one more object."""
        cls, address = type(thing), id(thing)
        self._alive.append(thing)
        if cls in PLAIN:
            self._put(cls.__name__, _bytes(thing))
        elif known := name_of(thing):
            self._put("known", known)
        elif isinstance(thing, np.ndarray | np.generic):
            self._array(thing)
        elif isinstance(thing, types.CodeType):
            self._code(thing)
        elif isinstance(thing, DESCRIPTORS):
            self._put("descriptor", f"{thing.__objclass__.__qualname__} {thing.__name__}")
        elif isinstance(thing, CONTAINERS) or (is_dataclass(thing) and not isinstance(thing, type)):
            if address in self._depth_of:
                self._put("cycle", len(self._depth_of) - self._depth_of[address])
                return
            self._depth_of[address] = len(self._depth_of)
            self._container(thing)
            del self._depth_of[address]
        elif address in self._number_of:
            self._put("again", self._number_of[address])
        else:
            self._number_of[address] = len(self._number_of)
            self._numbered(thing)

    def _numbered(self, thing: Any) -> None:
        """Hash a function, a class, a module or another object that is numbered."""
        cls = type(thing)
        match thing:
            case enum.Enum():
                self._add_parts("enum", cls, thing.name, thing.value)
            case types.FunctionType():
                self._function(thing)
            case types.MethodType():
                self._add_parts("method", thing.__func__, thing.__self__)
            case types.BuiltinFunctionType() | types.MethodWrapperType():
                self._add_parts("built in", thing.__name__, thing.__self__)
            case property():
                self._add_parts("property", thing.fget, thing.fset, thing.fdel)
            case staticmethod() | classmethod():
                self._add_parts(cls.__name__, thing.__func__)
            case functools.cached_property():
                self._add_parts("property", thing.func)
            case types.CellType():
                self._add_parts("cell", *_contents(thing))
            case types.MappingProxyType():
                self._add_parts("proxy", dict(thing))
            case types.ModuleType():
                self._put("module")
                self._add_by_name({k: v for k, v in vars(thing).items() if not _is_dunder(k)})
            case type():
                self._class(thing)
            case _ if isinstance(thing, NUMBERS):
                number: Any = thing  # of a user's subclass
                self._add_parts("of class", cls, attributes(thing), *number.__getnewargs__())
            case _ if release(cls.__module__) is not None and hasattr(cls, "__array__"):
                self._foreign_array(thing)
            case _ if is_opaque(cls):
                self._opaque(thing)
            case _:
                self._add_parts("object", cls)
                self._add_by_name(attributes(thing))

    def _foreign_array(self, thing: Any) -> None:
        """Hash type, dtype, shape and numbers of an array of PyTorch, JAX or another package."""
        array = thing.detach() if hasattr(thing, "detach") else thing  # of PyTorch
        numbers = array.tolist() if hasattr(array, "tolist") else np.asarray(array)
        self._add_parts("array of", type(thing), str(array.dtype), tuple(array.shape), numbers)

    def _array(self, given: Any) -> None:
        """Hash dtype, shape and bytes of an array; of records and objects, hash each part."""
        array = np.asarray(given)
        self._put(type(given).__name__, f"{array.dtype.str} {array.shape}")
        if isinstance(given, np.ma.MaskedArray):
            self._add_parts("mask", np.ma.getmaskarray(given), given.fill_value)
        if array.dtype.names is not None:
            for name in array.dtype.names:
                with self._below(name):
                    self._add_parts("field", name, array[name])
        elif array.dtype.hasobject:
            self._add_parts("entries", *array.ravel().tolist())
        else:
            self._put("bytes", array.tobytes())

    def _container(self, thing: Any) -> None:
        """Hash the content of a container or a dataclass."""
        if type(thing) not in CONTAINERS:
            self._add_parts("of class", type(thing), getattr(thing, "default_factory", None))
            self._add_by_name(attributes(thing))
        if isinstance(thing, dict):
            self._put("dict", len(thing))
            for key, value in thing.items():
                self.add(key)
                with self._below(key):
                    self.add(value)
        elif isinstance(thing, list | tuple):
            self._put("list" if isinstance(thing, list) else "tuple", len(thing))
            if len(thing) > LONG_LIST and set(map(type, thing)) == {float}:
                self._put("floats", np.array(thing, dtype=np.float64).tobytes())
                return
            for k, value in enumerate(thing):
                with self._below(k):
                    self.add(value)
        elif isinstance(thing, set | frozenset):
            hashes = sorted(of(entry, ": ".join(self.path)) for entry in thing)
            self._add_parts("set" if isinstance(thing, set) else "frozenset", *hashes)

    def _class(self, cls: Any) -> None:
        """Hash a class that no installed package holds."""
        self._put("class", cls.__qualname__)
        self._add_parts("bases", type(cls), *cls.__bases__)
        self._add_by_name({k: v for k, v in vars(cls).items() if _is_own_member(k, v)})

    def _code(self, code: types.CodeType) -> None:
        """Hash all of a code object that decides what it computes."""
        self._add_parts(
            "code", code.co_code, code.co_exceptiontable, code.co_argcount,
            code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags, code.co_names,
            code.co_varnames, code.co_freevars, code.co_cellvars, code.co_consts,
        )  # fmt: skip

    def _function(self, function: types.FunctionType) -> None:
        """Hash a function with its defaults, attributes, closure, and the globals that it reads."""
        code, namespace = function.__code__, function.__globals__
        self._put("function", function.__qualname__)
        self._code(code)
        with self._below("defaults"):
            self._add_parts("defaults", function.__defaults__, function.__kwdefaults__)
        self._add_by_name(vars(function))
        for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
            with self._below(f"closure {name}"):
                self._add_parts("cell", *_contents(cell))
        module = str(namespace.get("__name__"))
        if release(module) is not None:  # a function inside of a function of an installed package
            self._put("inside", f"{module} {release(module)}")
            return
        for chain in reads(code):
            with self._below(f"global {'.'.join(chain)}"):
                self._put("reads", ".".join(chain))
                self._read(chain, namespace)

    def _read(self, chain: tuple[str, ...], namespace: dict[str, Any]) -> None:
        """Hash the object that a function reads by a chain of names, see `reads`.

        The chain is followed through a user's modules. Any other object is hashed as a whole.
        """
        name, *rest = chain
        if name == "import":
            module = rest.pop(0)
            try:
                value: Any = importlib.import_module(module, namespace.get("__package__"))
            except ImportError:
                self._put("missing")
                return
        elif name in namespace:
            value = namespace[name]
        elif name in UNTRACEABLE:
            raise UnhashableError(f"{': '.join(self.path)}: what it reads is known when it runs")
        else:
            self._put("built in" if hasattr(builtins, name) else "missing")
            return
        while rest and isinstance(value, types.ModuleType) and release(value.__name__) is None:
            if not hasattr(value, rest[0]):
                self._put("missing")
                return
            value = getattr(value, rest.pop(0))
        self.add(value)

    def _opaque(self, thing: Any) -> None:
        """Hash an object of C by its pickle, or a compiled function by the function behind it."""
        inner = getattr(thing, "py_func", getattr(thing, "__wrapped__", None))
        if callable(inner):  # compiled by JAX or Numba, or cached by functools
            self._add_parts("compiled", type(thing), inner, getattr(thing, "targetoptions", None))
            return
        registered = copyreg.dispatch_table.get(type(thing))
        reduced: Any = registered(thing) if registered else thing.__reduce_ex__(4)
        if isinstance(reduced, str):
            module: Any = pickle.whichmodule(thing, reduced)  # type: ignore[attr-defined]
            if release(module) is None:
                raise UnhashableError(f"{': '.join(self.path)}: no name of a package: {reduced}")
            self._put("known", f"{module} {reduced} {release(module)}")
            return
        make, arguments, state, items, pairs = (*reduced, None, None, None)[:5]
        self._add_parts("pickled", make, arguments, state, list(items or ()), list(pairs or ()))


def _is_dunder(name: str) -> bool:
    return name.startswith("__") and name.endswith("__")


def _is_own_member(name: str, value: object) -> bool:
    """Return whether a class's author wrote a member, so that it belongs to the class's hash."""
    if isinstance(value, types.FunctionType | staticmethod | classmethod | property):
        return True
    is_made_by_python = isinstance(value, (*DESCRIPTORS, NAMED_TUPLE_FIELD))
    return not (is_made_by_python or name == "_abc_impl" or _is_dunder(name))


def _bytes(value: Any) -> bytes | str:
    """Return a plain value as bytes or text; floats as hexadecimal digits, which are exact."""
    if isinstance(value, float):
        return value.hex()
    return value if isinstance(value, bytes | str) else repr(value)


def _contents(cell: types.CellType) -> tuple[Any, ...]:
    """Return the content of a closure's cell as a tuple; an empty tuple if it has none."""
    try:
        return (cell.cell_contents,)
    except ValueError:
        return ()
