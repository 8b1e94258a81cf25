"""Environments by id, with what commands ask of them; a package of robots registers its own."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from hcbf_gym import plugins
from hcbf_gym.errors import InvalidInputError


class Known(NamedTuple):
    """What commands know of an environment."""

    robot: str | None  # what moves in it; None where the argument `robot` decides
    options: tuple[str, ...] = ()  # those arguments of `hcbf evaluate` that the environment takes
    # (arguments of the environment) → the user's files that decide what it does
    files: Callable[[Mapping[str, Any]], list[Path]] = lambda options: []


_ENVIRONMENTS: dict[str, Known] = {}


def known() -> dict[str, Known]:
    """Return id → what commands know of it, those of installed packages included."""
    plugins.load()
    return _ENVIRONMENTS


def register(env: str, facts: Known) -> None:
    """Add an environment of Gymnasium's registry, which takes `scenario` and `render_mode`.

    Raises:
        InvalidInputError: if the id is taken.
    """
    if _ENVIRONMENTS.setdefault(env, facts) is not facts:
        raise InvalidInputError(
            f"environment: got {env!r}, expected an id that is not registered: "
            f"{list(_ENVIRONMENTS)}"
        )


register("HCBF-A1Regions-v0", Known("Unitree A1", ("body",)))
register("HCBF-Regions-v0", Known("reduced-order model", ("intentions",)))
