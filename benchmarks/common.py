"""What suites share: jobs on all cores, tables by columns, calls timed in turn, parts."""

import contextlib
import os
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import joblib
import numpy as np
import tyro
from rich.console import Console

from hcbf_gym.arrays import Array
from hcbf_gym.errors import choose
from hcbf_gym.evaluation.tables import Table

Timed = tuple[Callable[[], Any], Callable[[], Any]]
"""What prepares a call, and the call that is timed."""
Parts = Mapping[str, tuple[Callable[[int], Table], int, int]]
"""part → what makes its table of a count, and the counts of a full and of a quick run."""


def table(
    title: str,
    rows: Iterable[Mapping[str, Any]],
    columns: Mapping[str, str | Callable[[Any], str]],
) -> Table:
    """Return a table of rows; a column is a format of the row's entries, or a function of it."""
    cells = [
        [cell.format_map(row) if isinstance(cell, str) else cell(row) for cell in columns.values()]
        for row in rows
    ]
    return Table(title, list(columns), cells)


def quietly(function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
    """Return what a function returns, without its warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return function(*arguments, **options)


def parallel(
    function: Callable[..., Any], jobs: Iterable[tuple[Any, ...]], workers: int = -1
) -> list[Any]:
    """Return `function` of every job's arguments, on all cores, without warnings."""
    calls = (joblib.delayed(quietly)(function, *job) for job in jobs)
    found: Any = joblib.Parallel(n_jobs=workers)(calls)
    return list(found)


@contextlib.contextmanager
def one_core() -> Iterator[None]:
    """Pin this process to one core."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


def in_turn(calls: Sequence[Timed], rounds: int, block: int = 1, warm: int = 0) -> Array:
    """Return each call's median time [µs]; they take turns, so that all see the same machine.

    In a round a call is prepared once and called `block` times, of which the first `warm` ones do
    not count. Nor does the first round.
    """
    times = np.empty((rounds + 1, block, len(calls)))
    for i in range(rounds + 1):
        for k, (prepare, call) in enumerate(calls):
            prepare()
            for j in range(block):
                start = time.perf_counter()
                call()
                times[i, j, k] = time.perf_counter() - start
    return 1e6 * np.median(times[1:, warm:], axis=(0, 1))


def nothing() -> None:
    """Prepare nothing."""


def run_parts(parts: Parts, quick: bool) -> dict[str, Any]:
    """Return the tables of every part, in JSON's terms."""
    made = {name: make(few if quick else many) for name, (make, many, few) in parts.items()}
    return {name: one._asdict() for name, one in made.items()}


def print_part(parts: Parts) -> None:
    """Run one part by the command line's ``--part`` and ``--count``, and print its table."""

    def main(part: str, count: int | None = None) -> None:
        """Run a part and print its table.

        Args:
            part: its name.
            count: points, episodes a map, paths or steps; that of a full run unless given.
        """
        make, many, _ = choose("part", part, parts)
        Console().print(make(many if count is None else count).rich())

    tyro.cli(main)
