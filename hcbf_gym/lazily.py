"""The names of a package, imported when they are first used (PEP 562)."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def names_of(package: str, where: Mapping[str, str]) -> Callable[[str], object]:
    """Return a package's ``__getattr__``.

    Args:
        package: its ``__name__``.
        where: name → its module below the package; a module's own name is the module.

    Examples:
        >>> names_of("collections", {"abc": "abc"})("abc").__name__
        'collections.abc'
    """

    def __getattr__(name: str) -> Any:  # noqa: N807 (what Python calls it)
        if name not in where:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = importlib.import_module(f"{package}.{where[name]}")
        return module if where[name] == name else getattr(module, name)

    return __getattr__
