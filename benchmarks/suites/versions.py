"""The present version beside version 0.1, each in a process of its own on one core, in turn.

Version 0.1 is taken out of the repository's history (`git archive`), so that the suite needs a
checkout. Both processes run the same file, `version_worker`.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.history import ROOT, take_out
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.evaluation.tables import Table

FIRST = "2dc8f6b"
"""The last commit of version 0.1."""
FILTERED = ("r-cbf-qp", "h-cbf-qp", "eh-cbf-qp", "lex-cbf-qp")

Case = dict[str, Any]


def cases(quick: bool) -> list[Case]:
    """Return what is timed, in blocks of so many steps."""
    short = 10 if quick else 1
    found: list[Case] = []
    for what, n, scenario, steps, chosen in (
        ("single", 1, "five rows", 500, ("none", "lex-cbf-qp")),
        ("Sync", 8, "five rows", 100, ("none", "lex-cbf-qp")),
        ("A1", 1, "paper-simulation", 60, ("none", "lex-cbf-qp")),
        ("native", 4096, "five rows", 20, ("none", *FILTERED)),
        ("native", 4096, "random", 20, ("none", *FILTERED)),
        ("batch", 4096, "four random rows", 10, ("cbf-qp", *FILTERED)),
    ):
        size = n // 16 if quick and n > 1000 else n
        found += [
            {"what": what, "n": size, "scenario": scenario, "program": program}
            | {"steps": max(steps // short, 2)}
            for program in chosen
        ]
    return found


def run(quick: bool) -> dict[str, Any]:
    """Time every case in both versions, in turn; return medians of the seconds of a step."""
    rounds, timed = 2 if quick else 15, cases(quick)
    with tempfile.TemporaryDirectory() as folder:
        take_out(FIRST, Path(folder), "hcbf_gym")
        workers = [_worker(ROOT), _worker(Path(folder))]
        try:
            rows = [case | _in_turn(workers, case, rounds) for case in timed]
        finally:
            for worker in workers:
                worker.kill()
    return {"first": FIRST, "rows": rows}


def _worker(checkout: Path) -> "subprocess.Popen[str]":
    """Start one version; both are pinned to the same core."""
    single = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    worker = subprocess.Popen(
        [sys.executable, "-P", str(Path(__file__).with_name("version_worker.py"))],
        env=os.environ | single | {"PYTHONPATH": str(checkout)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    os.sched_setaffinity(worker.pid, {max(os.sched_getaffinity(0))})
    return worker


def _in_turn(workers: list[Any], case: Case, rounds: int) -> dict[str, float]:
    """Return the seconds of a step of both versions, and the median ratio of neighbouring blocks.

    Raises:
        InvalidInputError: if a version ends instead of answering.
    """
    times = np.empty((rounds, len(workers)))
    for i in range(rounds):
        for k, worker in enumerate(workers):
            worker.stdin.write(json.dumps(case) + "\n")
            worker.stdin.flush()
            answer = worker.stdout.readline()
            if not answer:
                raise InvalidInputError(f"suite versions: version {k} ended at the case {case}")
            times[i, k] = float(answer)
    now, first = np.median(times, axis=0)
    return {"now": now, "first": first, "ratio": float(np.median(times[:, 1] / times[:, 0]))}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return rates beside those of 0.1."""
    rows = figures["rows"]
    rates = [
        (
            row["what"],
            str(row["n"]),
            row["scenario"],
            row["program"],
            f"{1.0 / row['now']:,.0f}",
            f"{1.0 / row['first']:,.0f}",
            f"{row['ratio']:.2f}",
            f"{_bare(rows, row)['first'] / row['now']:.0%}" if row["what"] != "batch" else "",
        )
        for row in rows
    ]
    header = ("environment", "N", "scene", "program", "steps/s", "0.1", "ratio", "of 0.1's bare")
    return {"rates": Table("Steps per second beside version 0.1", header, rates)}


def _bare(rows: list[Case], row: Case) -> Case:
    """Return the row of the same environment without a filter."""
    same = ("what", "n", "scenario")
    return next(
        other for other in rows
        if other["program"] == "none" and all(other[key] == row[key] for key in same)
    )  # fmt: skip
