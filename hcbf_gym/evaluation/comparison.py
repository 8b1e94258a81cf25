"""The table of `hcbf evaluate`: a column for each pair of a policy and a program."""

from collections.abc import Mapping, Sequence
from typing import Any

from hcbf_gym.barriers.set import Condition
from hcbf_gym.evaluation.rollouts import UNFILTERED, shown_program
from hcbf_gym.evaluation.sentences import unit_of
from hcbf_gym.evaluation.statistics import BOUNDED, INTERVAL, counted
from hcbf_gym.evaluation.tables import Table

FEW = 10  # with fewer episodes a bound on entering would be near 1, and the table has none
UNKNOWN = "–"

_FIGURES = (
    ("tracking error, RMS [m]", "tracking_rms", ".3f"),
    ("final error [m]", "final_error", ".3f"),
    ("‖u − u*‖, RMS [m/s²]", "intervention_rms", ".2f"),
    ("return", "return", ".2f"),
    ("episodes that fell", "fell", ".0%"),
    ("episodes that reached the goal", "reached", ".0%"),
    ("time to the goal [s]", "seconds_to_goal", ".2f"),
    ("time standing though u* wants to move", "deadlock_share", ".0%"),
)
"""(title, key in the rows, format) of each line with a mean over the episodes."""


def column_names(rows: list[dict[str, Any]]) -> list[str]:
    """Return the titles of columns: policy and program, or the program if there is one policy."""
    programs = [shown_program(row["program"]) for row in rows]
    if len({row["policy"] for row in rows}) == 1:
        return programs
    return [f"{row['policy']}\n{program}" for row, program in zip(rows, programs, strict=True)]


def comparison(
    rows: list[dict[str, Any]], conditions: Sequence[Condition], header: Sequence[str]
) -> Table:
    """Return a table with a column for each pair of policy and program.

    Args:
        rows: the figures of each pair, as `aggregate` returns them, of one environment and scene.
        conditions: the conditions of the scene.
        header: the titles of the columns.
    """
    episodes = rows[0]["episodes"]
    lines: list[list[str]] = []
    for k, (name, rank) in enumerate(conditions):
        title = f"{name} (rank {rank}): min h [{unit_of(name)}]"
        lines.append([title, *(f"{row['min_h'][k]:+.3f}" for row in rows)])
        lines.append(["time below 0 [s]", *(f"{row['violation_seconds'][k]:.2f}" for row in rows)])
    for title, key, form in _FIGURES:
        if key == "return" and rows[0].get("task") == "track":
            title = "return (rewards tracking alone)"
        if key in rows[0]:
            lines.append([title, *(_cell(row, key, form) for row in rows)])
    if episodes > 1:
        title, entered = "episodes that entered a strict region", [row["entered"] for row in rows]
        if episodes < FEW:
            lines.append([title, *map(str, entered)])
        else:
            lines.append([f"{title} ({BOUNDED})", *(counted(n, episodes) for n in entered)])
    for status in ("VIOLATED", "UNSAFE", "BACKUP"):
        counts = [
            UNKNOWN if row["program"] == UNFILTERED else str(row["status_counts"][status])
            for row in rows
        ]
        lines.append([f"steps with status {status}", *counts])
    policies = ", ".join(dict.fromkeys(row["policy"] for row in rows))
    title = f"{rows[0]['env']}, {rows[0]['scenario']}, {policies}, {episodes} "
    title += f"episodes each; [{INTERVAL:.0%} interval]" if episodes > 1 else "episode each"
    return Table(title, ("", *header), lines)


def _cell(row: Mapping[str, Any], key: str, form: str) -> str:
    """Return a figure as text, with its interval if there is one; a dash if it is not known."""
    value, interval = row[key], row.get("intervals", {}).get(key)
    if value is None:
        return UNKNOWN
    if interval is None or row["episodes"] == 1:
        return format(value, form)
    if form == ".0%":
        form = ".1%"  # the ends of an interval may differ by less than 1 %
    low, high = interval
    return f"{value:{form}} [{low:{form}}, {high:{form}}]"
