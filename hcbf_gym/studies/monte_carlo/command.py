"""Compare the programs in 1,000 random conflicting scenes: which priorities are entered, and how.

The reduced-order model under a held input, looked at every millisecond. Run it again to resume it.
"""

import json
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import joblib
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeElapsedColumn

from hcbf_gym.errors import InvalidInputError, choose
from hcbf_gym.evaluation.output_folder import open_folder, write_json
from hcbf_gym.evaluation.rollouts import in_parallel
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.studies.monte_carlo import episodes as monte_carlo


@dataclass(frozen=True)
class Args:
    """How much to run, and where to keep it."""

    episodes: int = 1000
    """Scenes for each policy and program; the same scenes for all."""
    policies: tuple[Literal["pd", "noisy", "adversarial"], ...] = ("pd", "noisy", "adversarial")
    """Nominal policies."""
    programs: tuple[str, ...] = tuple(monte_carlo.PROGRAMS)
    """Names from hcbf_gym.studies.monte_carlo.episodes.PROGRAMS."""
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
    results = compare(args)
    console = Console(width=200)
    for table in tables({"rows": results}).values():
        console.print(table.rich())


def compare(args: Args) -> list[dict[str, Any]]:
    """Run the chunks that are missing in the folder; return and save a row for each comparison.

    Raises:
        InvalidInputError: if an argument makes no sense, or the folder holds another study.
    """
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
    _run_missing(args, jobs)
    outcomes: dict[tuple[str, str, str], list[dict[str, Any]]] = defaultdict(list)
    for rows, policy, program, start in jobs:
        chunk = json.loads(_path(args, rows, policy, program, start).read_text(encoding="utf-8"))
        outcomes[rows, policy, program].extend(chunk[: args.episodes - start])
    results = [
        {"rows": rows, "policy": policy, "program": program, **monte_carlo.summary(episodes)}
        for (rows, policy, program), episodes in outcomes.items()
    ]
    write_json(args.output / "summary.json", results)
    return results


def _run_missing(args: Args, jobs: list[tuple[str, str, str, int]]) -> None:
    """Run the chunks that the folder does not hold yet, and save each as it is done."""
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


def _path(args: Args, rows: str, policy: str, program: str, start: int) -> Path:
    name = f"{rows}-{policy}-{program}-{start}".replace(" ", "_")
    return args.output / f"{name}.json"


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return who is entered under each kind of rows, and how near strict regions lex gets."""
    results = figures["rows"]
    kinds = dict.fromkeys(r["rows"] for r in results)
    priorities = {
        kind: _priorities(kind, [r for r in results if r["rows"] == kind]) for kind in kinds
    }
    return priorities | {"clearance": _clearance([r for r in results if r["program"] == "lex"])}


def _priorities(kind: str, results: list[dict[str, Any]]) -> Table:
    header = ("policy", "program", "enters 1", "2", "3", "4", "depth in 2/3/4 [m]")
    header += ("time in 2/3/4 [s]", "rms ‖u − u*‖", "at the goal", "deadlock", "entered though met")
    rows = [
        (
            r["policy"],
            r["program"],
            *(f"{share:.1%}" for share in r["entered"]),
            "/".join(f"{depth:.2f}" for depth in r["depth"][1:]),
            "/".join(f"{seconds:.1f}" for seconds in r["seconds"][1:]),
            f"{r['intervention']:.2f}",
            f"{r['reached']:.1%}",
            f"{r['deadlock']:.1%}",
            "/".join(str(count) for count in r["entered_though_met"]),
        )
        for r in results
    ]
    title = f"Share of episodes that enter a priority, mean depth within it; rows: {kind}"
    return Table(title, header, rows)


def _clearance(results: list[dict[str, Any]]) -> Table:
    header = ("rows", "policy", "episodes that enter a strict region")
    header += ("least clearance [mm]", "median clearance [mm]")
    rows = [
        (
            r["rows"],
            r["policy"],
            f"{r['entered'][0]:.1%}",
            f"{1e3 * r['least_clearance']:.2f}",
            f"{1e3 * r['median_clearance']:.2f}",
        )
        for r in results
    ]
    return Table("Clearance from strict regions under lex-cbf-qp", header, rows)
