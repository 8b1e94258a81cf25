"""Identity of objects: a hash over bytes, dtypes, shapes, fields and functions.

Two objects have the same hash only if every part of them is the same. A function counts with its
bytecode, constants and names, its defaults, its closure, and the globals and helpers that it reads;
not with line numbers or file names. A function or class of an installed package, of Python's
library or of this package counts by its name and the package's version.

The hash is the same in another process of the same minor version of Python. It does not depend on
addresses, on the order of sets, or on cached values (`functools.cached_property`).

>>> of({"gain": 1.0}) == of({"gain": 1.0}) != of({"gain": 2.0})
True
"""

import array
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
from hcbf_gym.errors import HcbfError

NUMBERS = int, float, complex, str, bytes
PLAIN = (*NUMBERS, bool, type(None), type(...), type(NotImplemented))
CONTAINERS = list, tuple, dict, set, frozenset
DESCRIPTORS = (
    types.WrapperDescriptorType, types.MethodDescriptorType, types.ClassMethodDescriptorType,
    types.GetSetDescriptorType, types.MemberDescriptorType,
)  # fmt: skip
FIELD = type(collections.namedtuple("_", "x").x)  # type: ignore[attr-defined]
"""Of a named tuple's class."""
HIDDEN = ("eval", "exec", "globals", "locals", "__import__")
"""Built-in functions that read what no bytecode names."""
MANY = 100
"""A longer list of floats is hashed in one piece."""


class UnhashableError(HcbfError, TypeError):
    """A part of an object has no bytes that identify it: a lock, a generator, an open file."""


def of(thing: object, name: str = "object") -> str:
    """Return the hash of an object, 20 hexadecimal digits.

    Args:
        thing: any.
        name: of it, in messages.

    Raises:
        UnhashableError: if a part of it cannot be hashed; the message names the part.
    """
    walk = _Walk(name)
    try:
        walk.add(thing)
    except UnhashableError:
        raise
    except Exception as error:  # a part's own code runs: its attributes, how it is pickled
        raise UnhashableError(f"{': '.join(walk.path)}: {error}") from error
    return walk.hash.hexdigest()[:20]


class _Walk:
    """One walk through an object.

    Numbers, arrays, containers and dataclasses count by what they contain, however often they
    occur. Functions, classes, modules and other objects are numbered where they are first met and
    count by their number afterwards: cycles end, and a large program is read once.
    """

    def __init__(self, name: str):
        self.path, self.hash = [name], hashlib.sha256()
        self._numbers: dict[int, int] = {}
        self._open: dict[int, int] = {}
        self._kept: list[object] = []  # so that no address comes again

    @contextmanager
    def _at(self, name: object) -> Iterator[None]:
        self.path.append(str(name))
        yield
        self.path.pop()  # not after an error, whose message names the path

    def _put(self, tag: str, data: Any = b"") -> None:
        """Hash a tag and bytes; with their length they cannot be read as others."""
        raw = data if isinstance(data, bytes) else str(data).encode("utf-8", "surrogatepass")
        self.hash.update(f"{tag} {len(raw)} ".encode())
        self.hash.update(raw)

    def _parts(self, tag: str, *parts: object) -> None:
        self._put(tag, len(parts))
        for part in parts:
            self.add(part)

    def _named(self, names: Mapping[str, Any], dunder: bool = True) -> None:
        """Hash values by their names, in the order of these."""
        for name in sorted(names):
            if dunder or not (name.startswith("__") and name.endswith("__")):
                with self._at(name):
                    self._put("name", name)
                    self.add(names[name])

    def add(self, thing: Any) -> None:
        """Hash one more object."""
        kind = type(thing)
        self._kept.append(thing)
        if kind in PLAIN:
            self._put(kind.__name__, _bytes(thing))
        elif known := name_of(thing):
            self._put("known", known)
        elif isinstance(thing, np.ndarray | np.generic):
            self._array(thing)
        elif isinstance(thing, types.CodeType):
            self._code(thing)
        elif isinstance(thing, DESCRIPTORS):
            self._put("descriptor", f"{thing.__objclass__.__qualname__} {thing.__name__}")
        elif isinstance(thing, CONTAINERS) or (is_dataclass(thing) and not isinstance(thing, type)):
            if id(thing) in self._open:
                self._put("cycle", len(self._open) - self._open[id(thing)])
                return
            self._open[id(thing)] = len(self._open)
            self._container(thing)
            del self._open[id(thing)]
        elif id(thing) in self._numbers:
            self._put("again", self._numbers[id(thing)])
        else:
            self._numbers[id(thing)] = len(self._numbers)
            self._object(thing)

    def _object(self, thing: Any) -> None:
        """Hash what is numbered."""
        if isinstance(thing, enum.Enum):
            self._parts("enum", type(thing), thing.name, thing.value)
        elif isinstance(thing, types.FunctionType):
            self._function(thing)
        elif isinstance(thing, types.MethodType):
            self._parts("method", thing.__func__, thing.__self__)
        elif isinstance(thing, types.BuiltinFunctionType | types.MethodWrapperType):
            self._parts("built in", thing.__name__, thing.__self__)
        elif isinstance(thing, property):
            self._parts("property", thing.fget, thing.fset, thing.fdel)
        elif isinstance(thing, staticmethod | classmethod):
            self._parts(type(thing).__name__, thing.__func__)
        elif isinstance(thing, functools.cached_property):
            self._parts("property", thing.func)
        elif isinstance(thing, types.CellType):
            self._parts("cell", *_contents(thing))
        elif isinstance(thing, types.MappingProxyType):
            self._parts("proxy", dict(thing))
        elif isinstance(thing, types.ModuleType):
            self._put("module")
            self._named(vars(thing), dunder=False)
        elif isinstance(thing, type):
            self._class(thing)
        elif isinstance(thing, NUMBERS):  # of a class of the user's own
            value: Any = thing
            self._parts("of class", type(thing), attributes(thing), *value.__getnewargs__())
        elif release(type(thing).__module__) is not None and hasattr(type(thing), "__array__"):
            whole = thing.detach() if hasattr(thing, "detach") else thing  # of torch
            numbers = whole.tolist() if hasattr(whole, "tolist") else np.asarray(whole)
            self._parts("array of", type(thing), str(whole.dtype), tuple(whole.shape), numbers)
        elif is_opaque(type(thing)):
            self._opaque(thing)
        else:
            self._parts("object", type(thing))
            self._named(attributes(thing))

    def _array(self, given: Any) -> None:
        """Hash dtype, shape and bytes; of records and objects each part."""
        whole = np.asarray(given)
        self._put(type(given).__name__, f"{whole.dtype.str} {whole.shape}")
        if isinstance(given, np.ma.MaskedArray):
            self._parts("mask", np.ma.getmaskarray(given), given.fill_value)
        if whole.dtype.names is not None:
            for name in whole.dtype.names:
                with self._at(name):
                    self._parts("field", name, whole[name])
        elif whole.dtype.hasobject:
            self._parts("entries", *whole.ravel().tolist())
        else:
            self._put("bytes", whole.tobytes())

    def _container(self, thing: Any) -> None:
        """Hash what a container or a dataclass contains."""
        if type(thing) not in CONTAINERS:
            self._parts("of class", type(thing), getattr(thing, "default_factory", None))
            self._named(attributes(thing))
        if isinstance(thing, dict):
            self._put("dict", len(thing))
            for key, value in thing.items():
                self.add(key)
                with self._at(key):
                    self.add(value)
        elif isinstance(thing, list | tuple):
            self._put("list" if isinstance(thing, list) else "tuple", len(thing))
            if len(thing) > MANY and set(map(type, thing)) == {float}:
                self._put("floats", array.array("d", thing).tobytes())
                return
            for k, value in enumerate(thing):
                with self._at(k):
                    self.add(value)
        elif isinstance(thing, set | frozenset):
            hashes = sorted(of(one, ": ".join(self.path)) for one in thing)
            self._parts("set" if isinstance(thing, set) else "frozenset", *hashes)

    def _class(self, cls: Any) -> None:
        """Hash a class that no installed package holds."""
        self._put("class", cls.__qualname__)
        self._parts("bases", type(cls), *cls.__bases__)
        methods = types.FunctionType, staticmethod, classmethod, property
        self._named({
            name: value
            for name, value in vars(cls).items()
            if isinstance(value, methods)
            or not (
                isinstance(value, (*DESCRIPTORS, FIELD))
                or name == "_abc_impl"
                or (name.startswith("__") and name.endswith("__"))
            )
        })  # fmt: skip

    def _code(self, code: types.CodeType) -> None:
        self._parts(
            "code", code.co_code, code.co_exceptiontable, code.co_argcount,
            code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags, code.co_names,
            code.co_varnames, code.co_freevars, code.co_cellvars, code.co_consts,
        )  # fmt: skip

    def _function(self, function: types.FunctionType) -> None:
        code, known = function.__code__, function.__globals__
        self._put("function", function.__qualname__)
        self._code(code)
        with self._at("defaults"):
            self._parts("defaults", function.__defaults__, function.__kwdefaults__)
        self._named(vars(function))
        for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
            with self._at(f"closure {name}"):
                self._parts("cell", *_contents(cell))
        module = str(known.get("__name__"))
        if release(module) is not None:  # a function within one of theirs
            self._put("inside", f"{module} {release(module)}")
            return
        for chain in reads(code):
            with self._at(f"global {'.'.join(chain)}"):
                self._put("reads", ".".join(chain))
                self._read(chain, known)

    def _read(self, chain: tuple[str, ...], known: dict[str, Any]) -> None:
        """Hash what a function reads by a name and the attributes behind it."""
        name, *rest = chain
        if name == "import":
            where = rest.pop(0)
            try:
                value: Any = importlib.import_module(where, known.get("__package__"))
            except ImportError:
                self._put("missing")
                return
        elif name in known:
            value = known[name]
        elif name in HIDDEN:
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
        """Hash an object of C as it is pickled, and one that is compiled by its function."""
        inner = getattr(thing, "py_func", getattr(thing, "__wrapped__", None))
        if callable(inner):  # of JAX, of functools
            self._parts("compiled", type(thing), inner, getattr(thing, "targetoptions", None))
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
        self._parts("pickled", make, arguments, state, list(items or ()), list(pairs or ()))


def _bytes(thing: Any) -> bytes | str:
    """Return a plain value in bytes or in digits."""
    if isinstance(thing, float):
        return thing.hex()
    return thing if isinstance(thing, bytes | str) else repr(thing)


def _contents(cell: types.CellType) -> tuple[Any, ...]:
    """Return what a cell contains; nothing where it is empty."""
    try:
        return (cell.cell_contents,)
    except ValueError:
        return ()
