"""What objects are made of: whose they are, which attributes they have, what their code reads."""

import copyreg
import dis
import functools
import importlib.metadata
import sys
import types
from typing import Any

from hcbf_gym import sources, version

DRAWN = ("_np_random", "_np_random_seed", "spec", "render_mode")
"""Attributes of Gymnasium's environments and spaces that decide no transition."""
WORD = 8  # of memory [byte]


def attributes(thing: Any) -> dict[str, Any]:
    """Return an object's attributes by name, but for those that were computed and kept."""
    cls = type(thing)
    found = dict(getattr(thing, "__dict__", {}))
    slots = copyreg._slotnames(cls)  # type: ignore[attr-defined]
    found |= {name: getattr(thing, name) for name in slots if hasattr(thing, name)}
    drawn = DRAWN if any(one.__module__.startswith("gymnasium.") for one in cls.__mro__) else ()
    return {
        name: value
        for name, value in found.items()
        if not isinstance(getattr(cls, name, None), functools.cached_property) and name not in drawn
    }


def release(module: str) -> str | None:
    """Return the version of the installed package that a module belongs to; None of the user's."""
    top = module.partition(".")[0]
    return version.release() if top in sources.NAMES else _installed(top)


@functools.cache
def _installed(top: str) -> str | None:
    if top in sys.stdlib_module_names or top == "builtins":
        return "{}.{}".format(*sys.version_info)
    found = sys.modules.get(top)
    file = str(getattr(found, "__file__", None) or [*getattr(found, "__path__", ()), ""][0])
    if "site-packages" not in file and "dist-packages" not in file:
        return None
    try:
        return importlib.metadata.version(top)
    except importlib.metadata.PackageNotFoundError:
        return str(getattr(found, "__version__", ""))


def name_of(thing: Any) -> str:
    """Return name and version of what an installed package holds; "" for anything else."""
    if isinstance(thing, types.ModuleType):
        known = release(thing.__name__)
        return "" if known is None else f"module {thing.__name__} {known}"
    name = getattr(thing, "__qualname__", getattr(thing, "__name__", None))
    if not callable(thing) or not isinstance(name, str):
        return ""
    owner = type(getattr(thing, "__self__", None)).__module__
    for module in (getattr(thing, "__module__", None), owner):
        known = release(module) if isinstance(module, str) else None
        for one in () if known is None else (name, name.rpartition(".")[2]):
            found: Any = sys.modules.get(str(module))
            for part in one.split("."):
                found = getattr(found, part, None)
            if found is thing:
                return f"{module} {one} {known}"
    return ""


def is_opaque(cls: Any) -> bool:
    """Return whether objects of a class hold more than their attributes, as those of C may."""
    offsets = (cls.__dictoffset__, cls.__weakrefoffset__)
    words = len(copyreg._slotnames(cls)) + sum(one > 0 for one in offsets)  # type: ignore[attr-defined]
    return cls.__basicsize__ > object.__basicsize__ + WORD * words


@functools.lru_cache(maxsize=4096)
def reads(code: types.CodeType) -> tuple[tuple[str, ...], ...]:
    """Return the globals that code reads, each with the attributes that follow it."""
    found: dict[tuple[str, ...], None] = {}
    listed = list(dis.get_instructions(code))
    for k, one in enumerate(listed):
        name, after = str(one.argval), listed[k + 1 :]
        if one.opname == "IMPORT_NAME":
            level = next(i.argval for i in reversed(listed[:k]) if isinstance(i.argval, int))
            where = "." * level + name
            taken = []
            for other in after:
                if other.opname == "IMPORT_FROM":
                    taken.append(other.argval)
                elif not other.opname.startswith("STORE_"):
                    break
            found |= dict.fromkeys([("import", where, t) for t in taken] or [("import", where)])
        elif one.opname in ("LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS"):
            chain = [name]
            for other in after:
                if other.opname not in ("LOAD_ATTR", "LOAD_METHOD"):
                    break
                chain.append(other.argval)
            found[tuple(chain)] = None
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            found |= dict.fromkeys(reads(constant))
    return tuple(found)
