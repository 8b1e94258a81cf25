"""Compare the programs in 1,000 random conflicting scenes: which priorities are entered, and how.

The reduced-order model under a held input, looked at every millisecond. Run it again to resume it.
"""

import os
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

os.environ.setdefault("OMP_NUM_THREADS", "1")

import json

import joblib
import tyro
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeElapsedColumn
from rich.table import Table

from hcbf_gym.errors import HcbfError, InvalidInputError, choose
from hcbf_gym.evaluation.output_folder import open_folder, write_json
from hcbf_gym.evaluation.rollouts import in_parallel
from hcbf_gym.studies.benchmarks import monte_carlo


@dataclass(frozen=True)
class Args:
    """How much to run, and where to keep it."""

    episodes: int = 1000
    """Scenes for each policy and program; the same scenes for all."""
    policies: tuple[Literal["pd", "noisy", "adversarial"], ...] = ("pd", "noisy", "adversarial")
    """Nominal policies."""
    programs: tuple[str, ...] = tuple(monte_carlo.PROGRAMS)
    """Names from hcbf_gym.studies.benchmarks.monte_carlo.PROGRAMS."""
    rows: tuple[Literal["held", "continuous", "continuous + 1 cm"], ...] = ("held",)
    """Rows made for a held input, the usual ones, or those with a margin."""
    seed: int = 0
    """Decides scenes and noise."""
    chunk: int = 100
    """Episodes that run together and are saved together."""
    workers: int = 1
    """Processes."""
    backend: Literal["loky", "multiprocessing", "threading", "ray"] = "loky"
    """A joblib backend; "ray" runs on a cluster."""
    output: Path = Path("results/monte-carlo")
    """Folder of the chunks and of summary.json."""


def main(args: Args) -> None:
    """Run what is missing, then print and save the tables."""
    if args.episodes < 1 or args.chunk < 1:
        raise InvalidInputError(
            f"got episodes {args.episodes} and chunk {args.chunk}, expected >= 1"
        )
    for program in args.programs:
        choose("program", program, monte_carlo.PROGRAMS)
    open_folder(args.output, {"seed": args.seed, "chunk": args.chunk})
    jobs = [
        (rows, policy, program, start)
        for rows in args.rows
        for policy in args.policies
        for program in args.programs
        for start in range(0, args.episodes, args.chunk)
    ]
    missing = [job for job in jobs if not _path(args, *job).exists()]
    tasks = [
        joblib.delayed(monte_carlo.run)(policy, program, rows, args.seed, start, args.chunk)
        for rows, policy, program, start in missing
    ]
    columns = (*Progress.get_default_columns(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        bar = progress.add_task("chunks", total=len(jobs), completed=len(jobs) - len(missing))
        done = in_parallel(tasks, args.workers, args.backend)
        for job, outcomes in zip(missing, done, strict=True):
            write_json(_path(args, *job), outcomes)
            progress.advance(bar)

    outcomes: dict[tuple[str, str, str], list[dict[str, Any]]] = defaultdict(list)
    for rows, policy, program, start in jobs:
        chunk = json.loads(_path(args, rows, policy, program, start).read_text(encoding="utf-8"))
        outcomes[rows, policy, program].extend(chunk[: args.episodes - start])
    results = [
        {"rows": rows, "policy": policy, "program": program, **monte_carlo.summary(episodes)}
        for (rows, policy, program), episodes in outcomes.items()
    ]
    write_json(args.output / "summary.json", results)
    _print(results)


def _path(args: Args, rows: str, policy: str, program: str, start: int) -> Path:
    name = f"{rows}-{policy}-{program}-{start}".replace(" ", "_")
    return args.output / f"{name}.json"


def _print(results: list[dict[str, Any]]) -> None:
    table = Table(title="Share of episodes that enter a priority, mean depth of those within it")
    headers = ("rows", "policy", "program", "1", "2", "3", "4", "depth 2/3/4 [m]", "seconds 2/3/4")
    headers += ("|u-u*| [m/s²]", "reached", "entered though met", "clearance: least, median [mm]")
    for header in headers:
        table.add_column(header)
    for r in results:
        table.add_row(
            r["rows"],
            r["policy"],
            r["program"],
            *(f"{share:.1%}" for share in r["entered"]),
            "/".join(f"{depth:.2f}" for depth in r["depth"][1:]),
            "/".join(f"{seconds:.1f}" for seconds in r["seconds"][1:]),
            f"{r['intervention']:.2f}",
            f"{r['reached']:.1%}",
            "/".join(str(count) for count in r["entered_though_met"]),
            f"{1e3 * r['least_clearance']:.2f}, {1e3 * r['median_clearance']:.2f}",
        )
    Console(width=200).print(table)


if __name__ == "__main__":
    try:
        main(tyro.cli(Args, description=__doc__))
    except HcbfError as error:
        raise SystemExit(str(error)) from error
