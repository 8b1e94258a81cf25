"""What episodes showed of each rank, in sentences that follow from the numbers."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

SPEED = "speed limit"
"""The condition that the environments add for a cap on the speed; its h is in m/s."""


def sentences(row: Mapping[str, Any], conditions: Sequence[tuple[str, int]]) -> list[str]:
    """Return a sentence for each rank, the first rank first.

    Args:
        row: of a policy under a program, as `rollouts.aggregate` returns it.
        conditions: name and rank of the scene's.
    """
    least = np.array(row["min_h"])
    found = []
    for rank in sorted({rank for _, rank in conditions}):
        members = [k for k, (_, of) in enumerate(conditions) if of == rank]
        worst = min(members, key=lambda k: float(least[k]))
        name = conditions[worst][0]
        unit = "m/s" if name == SPEED else "m"
        seen = f"(least h {least[worst]:.2f} {unit}, {name})"
        count = int(row["episodes"])
        entered = round(count * max(float(row["share_entered"][k]) for k in members))
        seconds = float(row["relaxed_seconds"].get(str(rank), 0.0))
        each = " an episode" if count > 1 else ""
        if rank == 1:
            held = "held in all episodes" if entered == 0 else "was violated"
            found.append(f"Rank 1 {held} {seen}.")
        elif seconds > 0.0:
            found.append(f"Rank {rank} was relaxed for {seconds:.1f} s{each} {seen}.")
        elif entered:
            found.append(f"Rank {rank} was violated {seen}.")
        else:
            found.append(f"Rank {rank} held {seen}.")
    return found
