"""The environments that commands accept, by id; packages of robots register theirs."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from hcbf_gym import plugins
from hcbf_gym.errors import InvalidInputError


class Known(NamedTuple):
    """Facts about an environment that commands need before it is made."""

    robot: str | None  # its name in summaries; None where the argument `robot` decides
    options: tuple[str, ...] = ()  # the arguments of `hcbf evaluate` that the environment takes
    # (the environment's arguments) → the user's files that decide its episodes
    files: Callable[[Mapping[str, Any]], list[Path]] = lambda env_options: []


_ENVIRONMENTS: dict[str, Known] = {}


def known() -> dict[str, Known]:
    """Return id → the facts about each registered environment, also of installed plugins."""
    plugins.load()
    return _ENVIRONMENTS


def register(env: str, facts: Known) -> None:
    """Let commands accept the id of an environment, which takes `scenario` and `render_mode`.

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
