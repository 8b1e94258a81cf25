"""Packages above this one: what they register is known once their entry points are loaded."""

import functools
from importlib import metadata

from hcbf_gym.arguments import Subcommand
from hcbf_gym.errors import InvalidInputError

GROUP = "hcbf.commands"
"""The group of entry points by which packages add commands: name → a dict of `Subcommand`."""


@functools.cache
def load() -> dict[str, Subcommand]:
    """Import the installed packages of the group, which register scenes and environments.

    Returns:
        name → command, of all of them.

    Raises:
        InvalidInputError: if one of them cannot be imported.
    """
    found: dict[str, Subcommand] = {}
    for point in sorted(metadata.entry_points(group=GROUP), key=lambda point: point.name):
        try:
            found |= point.load()
        except Exception as error:  # of another package's code
            raise InvalidInputError(
                f"entry point {point.name!r} of {GROUP}: got {error!r}, expected {point.value} to "
                "be importable; uninstall or repair its package"
            ) from error
    return found
