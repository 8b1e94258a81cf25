"""The structure of objects: their package, their attributes, and the globals that code reads."""

import copyreg
import dis
import functools
import importlib.metadata
import itertools
import sys
import types
from typing import Any

from hcbf_gym import sources, version

NOT_DYNAMICS = ("_np_random", "_np_random_seed", "spec", "render_mode")
"""Attributes of Gymnasium's environments and spaces that do not change a transition."""
POINTER_BYTES = 8
GLOBAL_READS = ("LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS")
ATTRIBUTE_READS = ("LOAD_ATTR", "LOAD_METHOD")
IMPORT_PARTS = ("IMPORT_FROM", "STORE_")  # the instructions of ``from module import a, b as c``


def attributes(thing: Any) -> dict[str, Any]:
    """Return an object's attributes by name, without cached properties and `NOT_DYNAMICS`."""
    cls = type(thing)
    values = dict(getattr(thing, "__dict__", {}))
    slots = copyreg._slotnames(cls)  # type: ignore[attr-defined]
    values |= {name: getattr(thing, name) for name in slots if hasattr(thing, name)}
    is_gymnasium = any(base.__module__.startswith("gymnasium.") for base in cls.__mro__)
    left_out = NOT_DYNAMICS if is_gymnasium else ()
    return {
        name: value
        for name, value in values.items()
        if not isinstance(getattr(cls, name, None), functools.cached_property)
        and name not in left_out
    }


def release(module: str) -> str | None:
    """Return the version of the installed package of a module; None for a user's module."""
    package = module.partition(".")[0]
    return version.release() if package in sources.NAMES else _installed_version(package)


@functools.cache
def _installed_version(package: str) -> str | None:
    """Return the version of Python for its library, of an installed package, or None."""
    if package in sys.stdlib_module_names or package == "builtins":
        return "{}.{}".format(*sys.version_info)
    module = sys.modules.get(package)
    folders = [*getattr(module, "__path__", ()), ""]
    file = str(getattr(module, "__file__", None) or folders[0])
    if "site-packages" not in file and "dist-packages" not in file:
        return None
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return str(getattr(module, "__version__", ""))


def name_of(thing: Any) -> str:
    """Return name and version of an object that an installed package holds; "" for any other."""
    if isinstance(thing, types.ModuleType):
        package_version = release(thing.__name__)
        return "" if package_version is None else f"module {thing.__name__} {package_version}"
    name = getattr(thing, "__qualname__", getattr(thing, "__name__", None))
    if not callable(thing) or not isinstance(name, str):
        return ""
    owner = type(getattr(thing, "__self__", None)).__module__  # of a bound method of C
    for module in (getattr(thing, "__module__", None), owner):
        package_version = release(module) if isinstance(module, str) else None
        if package_version is None:
            continue
        for path in (name, name.rpartition(".")[2]):
            if _attribute_at(str(module), path) is thing:
                return f"{module} {path} {package_version}"
    return ""


def _attribute_at(module: str, path: str) -> Any:
    """Return the object at a dotted path of attributes in a module; None if there is none."""
    found: Any = sys.modules.get(module)
    for name in path.split("."):
        found = getattr(found, name, None)
    return found


def is_opaque(cls: Any) -> bool:
    """Return whether objects of a class may hold data in C besides their Python attributes."""
    # Python's own objects have a pointer for each slot, for their dictionary, for weak references
    slots = copyreg._slotnames(cls)  # type: ignore[attr-defined]
    pointers = len(slots) + (cls.__dictoffset__ > 0) + (cls.__weakrefoffset__ > 0)
    return cls.__basicsize__ > object.__basicsize__ + POINTER_BYTES * pointers


@functools.lru_cache(maxsize=4096)
def reads(code: types.CodeType) -> tuple[tuple[str, ...], ...]:
    """Return the globals that code reads, each as a chain of names: ("np", "linalg", "norm").

    An import within the code is the chain ("import", module) or ("import", module, name).
    """
    chains: dict[tuple[str, ...], None] = {}  # a set that retains the order
    instructions = list(dis.get_instructions(code))
    for k, instruction in enumerate(instructions):
        name, after = str(instruction.argval), itertools.islice(instructions, k + 1, None)
        if instruction.opname == "IMPORT_NAME":
            # the level of a relative import is the number that was loaded last
            loaded = (i.argval for i in reversed(instructions[:k]))
            level = next(value for value in loaded if isinstance(value, int))
            module = "." * level + name
            imports = itertools.takewhile(lambda i: i.opname.startswith(IMPORT_PARTS), after)
            taken = [i.argval for i in imports if i.opname == "IMPORT_FROM"]
            chains |= dict.fromkeys([("import", module, n) for n in taken] or [("import", module)])
        elif instruction.opname in GLOBAL_READS:
            attributes_read = itertools.takewhile(lambda i: i.opname in ATTRIBUTE_READS, after)
            chains[name, *(i.argval for i in attributes_read)] = None
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):  # a function within this one
            chains |= dict.fromkeys(reads(constant))
    return tuple(chains)
