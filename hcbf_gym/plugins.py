"""Packages above this one: what they register is known once their entry points are loaded."""

import functools
from importlib import metadata

from hcbf_gym.arguments import Subcommand

GROUP = "hcbf.commands"
"""The group of entry points by which packages add commands: name → a dict of `Subcommand`."""


@functools.cache
def load() -> dict[str, Subcommand]:
    """Import the installed packages of the group, which register scenes and environments.

    Returns:
        name → command, of all of them.
    """
    found: dict[str, Subcommand] = {}
    for point in sorted(metadata.entry_points(group=GROUP), key=lambda point: point.name):
        found |= point.load()
    return found
