"""What finished episodes showed, kept on file, so that an interrupted study goes on."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol, TypeVar

from hcbf_gym.evaluation import chunks

Outcome = TypeVar("Outcome", covariant=True)


class EpisodeOf(Protocol[Outcome]):
    """A dataclass of JSON types that says what to run; it decides the outcome, a dataclass, too."""

    def run(self) -> Outcome:
        """Run the episode to its end."""
        ...


class OutcomeFile:
    """The outcomes of episodes that ran on the present sources, a line of JSON each.

    Args:
        path: of the file; lines of other sources stay, and are not read.
        version: of the sources that outcomes depend on.
    """

    def __init__(self, path: Path, version: str):
        self._path, self._version = path, version
        self._known: dict[str, dict[str, Any]] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                entry = json.loads(line)
                if entry["version"] == self._version:
                    self._known[entry["episode"]] = entry["outcome"]

    def of(
        self, kind: type[Outcome], episodes: Sequence[EpisodeOf[Outcome]], title: str = ""
    ) -> list[Outcome]:
        """Return the episodes' outcomes, in order; run those that are not on file, on all cores.

        Args:
            kind: the class of the outcomes.
            episodes: of one class.
            title: of a progress bar; none is shown without one.
        """
        keys = [_key(episode) for episode in episodes]
        missing = [k for k, key in enumerate(keys) if key not in self._known]
        fresh = chunks.run(_run, [episodes[k] for k in missing], title=title or None)
        with self._path.open("a", encoding="utf-8") as file:
            for number, outcome in fresh:
                k = missing[number]
                self._known[keys[k]] = asdict(outcome)
                entry = {"version": self._version, "episode": keys[k], "outcome": asdict(outcome)}
                file.write(json.dumps(entry) + "\n")
                file.flush()
        return [kind(**self._known[key]) for key in keys]


def _run(episode: EpisodeOf[Any]) -> Any:
    return episode.run()


def _key(episode: Any) -> str:
    return type(episode).__name__ + json.dumps(asdict(episode), sort_keys=True)
