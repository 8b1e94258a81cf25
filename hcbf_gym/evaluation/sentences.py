"""What episodes showed of each rank, in sentences that follow from the numbers."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

SPEED = "speed limit"
"""The condition that the environments add for a cap on the speed; its h is in m/s."""


def unit_of(name: str) -> str:
    """Return the unit of the h of a condition, by the condition's name."""
    return "m/s" if name == SPEED else "m"


def sentences(row: Mapping[str, Any], conditions: Sequence[tuple[str, int]]) -> list[str]:
    """Return a sentence for each rank, the first rank first.

    A rank is relaxed while a row of it is violated, and entered while its h is negative: the row
    is violated before, where h falls too fast, and met again before the robot has left.

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
        seen = f"(least h {least[worst]:.2f} {unit_of(name)}, {name})"
        each = " an episode" if int(row["episodes"]) > 1 else ""
        entered = max(float(row["share_entered"][k]) for k in members) > 0.0
        inside = f"{row['violation_seconds'][worst]:.1f} s{each}"
        seconds = float(row["relaxed_seconds"].get(str(rank), 0.0))
        did = "exceeded" if name == SPEED else "entered"
        if rank == 1:
            held = f"was violated for {inside}" if entered else "held in all episodes"
        elif seconds > 0.0:
            relaxed = f"was relaxed for {seconds:.1f} s"
            held = f"{relaxed} and {did} for {inside}" if entered else f"{relaxed}{each}, not {did}"
        else:
            held = f"was {did} for {inside}" if entered else "held"
        found.append(f"Rank {rank} {held} {seen}.")
    return found
