"""Which of the package's sources decide an episode, and what they are today."""

import functools

from hcbf_gym import compilation

EPISODES = compilation.PACKAGE / "evaluation" / "certification" / "families.py"
"""Where what an episode is begins; all that it imports counts."""


@functools.cache
def today() -> str:
    """Return a hash of the sources that decide an episode: some 30 ms, once in a process.

    A user's own files are no part of it: what a plant declares tells of those.
    """
    return compilation.sources_hash([EPISODES, *compilation.read_by_name()])
