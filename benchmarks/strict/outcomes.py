"""What episodes showed, each run once as long as the sources are the same."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from hcbf_gym.evaluation import chunks

Outcome = TypeVar("Outcome", covariant=True)


class EpisodeOf(Protocol[Outcome]):
    """A dataclass that says what to run."""

    def run(self) -> Outcome:
        """Run the episode to its end."""
        ...


def outcomes(
    episodes: Sequence[EpisodeOf[Outcome]],
    folder: Path,
    reads: Sequence[Path] = (),
    title: str | None = None,
    workers: int | None = None,
) -> list[Outcome]:
    """Return the episodes' outcomes, in order; run those that are not in the folder.

    Args:
        episodes: of one class.
        folder: where finished ones are kept.
        reads: files that decide them beside the sources of their class.
        title: of a progress bar; none is shown without one.
        workers: episodes that run at once; None for as many as there are cores.
    """
    if not episodes:
        return []
    run: Any = type(episodes[0]).run
    runs = chunks.run(run, episodes, folder=folder, reads=reads, title=title, workers=workers)
    return chunks.in_order(runs)
