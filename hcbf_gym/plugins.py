"""Installed packages that extend this one, found by their entry points."""

import functools
from importlib import metadata

from hcbf_gym.arguments import Subcommand
from hcbf_gym.errors import InvalidInputError, in_words

GROUP = "hcbf.commands"
"""The group of entry points by which packages add commands: each is a dict of `Subcommand`."""


@functools.cache
def load() -> dict[str, Subcommand]:
    """Import all packages of `GROUP`, which register their scenes; return name → command.

    Raises:
        InvalidInputError: if a package cannot be imported.
    """
    commands: dict[str, Subcommand] = {}
    for point in sorted(metadata.entry_points(group=GROUP), key=lambda point: point.name):
        try:
            commands |= point.load()
        except Exception as error:  # of another package's code
            raise InvalidInputError(
                f"entry point {point.name!r} of {GROUP}: got {in_words(error)}, expected "
                f"{point.value} to be importable; uninstall or repair its package"
            ) from error
    return commands
