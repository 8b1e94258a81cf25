"""Sentences for the terminal, one for each rank, which follow from a row of the table."""

from collections.abc import Mapping, Sequence
from typing import Any

SPEED = "speed limit"  # the condition that environments add for a cap on the speed; h in m/s


def unit_of(name: str) -> str:
    """Return the unit of the h of the condition with this name."""
    return "m/s" if name == SPEED else "m"


def sentences(row: Mapping[str, Any], conditions: Sequence[tuple[str, int]]) -> list[str]:
    """Return a sentence for each rank, that of rank 1 first.

    A rank is relaxed while one of its rows is violated, and entered while one of its h is negative.
    If h falls too fast, its row is violated earlier, and satisfied before the robot has left.

    Args:
        row: the row of a policy under a program, as `rollouts.aggregate` returns it.
        conditions: (name, rank) of each of the scene's conditions.
    """
    ranks = sorted({rank for _, rank in conditions})
    return [_sentence(row, conditions, rank) for rank in ranks]


def _sentence(row: Mapping[str, Any], conditions: Sequence[tuple[str, int]], rank: int) -> str:
    """Return the sentence for one rank, with the least h among its conditions."""
    members = [k for k, (_, its_rank) in enumerate(conditions) if its_rank == rank]
    worst = min(members, key=lambda k: float(row["min_h"][k]))
    name, least_h = conditions[worst][0], float(row["min_h"][worst])
    per_episode = " an episode" if int(row["episodes"]) > 1 else ""
    is_entered = any(float(row["share_entered"][k]) > 0.0 for k in members)
    inside = f"{row['violation_seconds'][worst]:.1f} s{per_episode}"
    relaxed_seconds = float(row["relaxed_seconds"].get(str(rank), 0.0))
    relaxed = f"was relaxed for {relaxed_seconds:.1f} s"
    entered = "exceeded" if name == SPEED else "entered"
    if rank == 1:
        outcome = f"was violated for {inside}" if is_entered else "held in all episodes"
    elif relaxed_seconds > 0.0 and is_entered:
        outcome = f"{relaxed} and {entered} for {inside}"
    elif relaxed_seconds > 0.0:
        outcome = f"{relaxed}{per_episode}, not {entered}"
    else:
        outcome = f"was {entered} for {inside}" if is_entered else "held"
    return f"Rank {rank} {outcome} (least h {least_h:.2f} {unit_of(name)}, {name})."
