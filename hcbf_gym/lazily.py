"""Packages whose names are imported when they are first used (PEP 562)."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def names_of(package: str, modules: Mapping[str, str]) -> Callable[[str], object]:
    """Return the ``__getattr__`` of a package, which imports a name when it is first read.

    Args:
        package: the package's ``__name__``.
        modules: name → the module below the package that defines it; a module's own name → itself.

    Examples:
        >>> names_of("collections", {"abc": "abc"})("abc").__name__
        'collections.abc'
    """

    def __getattr__(name: str) -> Any:  # noqa: N807 (Python calls it so)
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = importlib.import_module(f"{package}.{modules[name]}")
        return module if modules[name] == name else getattr(module, name)

    return __getattr__
