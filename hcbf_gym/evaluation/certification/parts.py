"""What several machines saw of one plan of seeds: files of ranges, put together without gaps."""

import hashlib
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym import records
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.evaluation.certification.certify import Frozen
from hcbf_gym.evaluation.certification.families import Seen


def plan_of(frozen: Frozen) -> str:
    """Return a hash of all that was fixed before the first episode."""
    said = frozen.fields()
    margins = said["margins"]
    said["margins"] = None if margins is None else margins._asdict()
    text = json.dumps(records.plain(said), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def save(path: Path, plan: str, first: int, seen: Sequence[Seen]) -> None:
    """Write a range of episodes to a JSON file.

    Args:
        path: of the file.
        plan: of which they are, as `plan_of` tells it.
        first: the number of the first one, from 0.
        seen: what they showed, in their order.
    """
    data = {"plan": plan, "first": first, "seen": [_plain(one) for one in seen]}
    path.parent.mkdir(parents=True, exist_ok=True)
    with records.whole(path) as partial:
        partial.write_text(json.dumps(data) + "\n", encoding="utf-8")


def together(paths: Iterable[Path], plan: str) -> list[Seen]:
    """Return what the episodes from the first one on showed, as far as there is no gap.

    Args:
        paths: of files that `save` wrote.
        plan: of which they must be.

    Raises:
        InvalidInputError: if one cannot be read, is of another plan, or two overlap.
    """
    seen: list[Seen] = []
    end = 0
    for first, path, part in sorted((_read(path, plan) for path in paths), key=lambda p: p[:2]):
        if first < end:
            raise InvalidInputError(
                f"parts: got {path} from episode {first}, expected {end} or a later one: ranges "
                "overlap, and an episode counts once"
            )
        if first == len(seen):  # what lies beyond a gap waits for it
            seen += part
        end = first + len(part)
    return seen


def _plain(one: Seen) -> dict[str, Any]:
    said = records.plain(one._asdict())
    return said | {"least_speed_h": None if np.isinf(one.least_speed_h) else one.least_speed_h}


def _seen(said: dict[str, Any]) -> Seen:
    values: dict[str, Any] = dict(said)
    if values["least_speed_h"] is None:
        values["least_speed_h"] = np.inf
    return Seen(**values)


def _read(path: Path, plan: str) -> tuple[int, Path, list[Seen]]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        parts = [_seen(one) for one in data["seen"]]
        first, of = int(data["first"]), data["plan"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InvalidInputError(
            f"parts: got {path} ({error!r}), expected a file that `hcbf certify --part` wrote"
        ) from error
    if of != plan:
        raise InvalidInputError(
            f"parts: got {path} of the plan {of!r}, expected {plan!r}: the same plant, margins, "
            "seeds, sources and versions on every machine"
        )
    return first, path, parts
