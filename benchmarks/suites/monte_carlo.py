"""Compare the programs in 1,000 random conflicting scenes: which priorities are entered, and how.

The reduced-order model under a held input, sampled every millisecond. Run it again to resume it.
As a suite it gives the tables of docs/programs.md; `scripts/random_conflicts.py` takes arguments.
"""

import itertools
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from rich.console import Console

from benchmarks import random_conflicts
from hcbf_gym.errors import InvalidInputError, choose
from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_gym.evaluation.output_folder import open_folder, write_json
from hcbf_gym.evaluation.statistics import BOUNDED, at_most
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.evaluation.workers import Backend


@dataclass(frozen=True)
class Args:
    """How much to run, and where to keep it."""

    episodes: int = 1000
    """Scenes for each policy and program; the same scenes for all."""
    policies: tuple[Literal["pd", "noisy", "adversarial"], ...] = ("pd", "noisy", "adversarial")
    """Nominal policies."""
    programs: tuple[str, ...] = tuple(random_conflicts.PROGRAMS)
    """Names from benchmarks.random_conflicts.PROGRAMS."""
    rows: tuple[Literal["held", "continuous", "continuous + 1 cm"], ...] = ("held",)
    """Rows made for a held input, the usual ones, or those with a margin."""
    seed: int = 0
    """Decides scenes and noise."""
    chunk: int = 100
    """Episodes that run together and are saved together."""
    workers: int | None = None
    """Chunks that run at once [default: as many as the backend has CPUs]."""
    backend: Backend = "processes"
    """Where they run; ray needs the extra `cluster`."""
    output: Path = Path("results/monte-carlo")
    """Folder of the chunks and of summary.json."""


def main(args: Args) -> None:
    """Run what is missing, then print and save the tables."""
    results = compare(args)
    console = Console(width=200)
    for table in tables({"rows": results}).values():
        console.print(table.rich())


def run(quick: bool) -> dict[str, Any]:
    """Return the figures of the suite: held rows everywhere, the others under lex-cbf-qp.

    Args:
        quick: few scenes, and one policy.
    """
    with tempfile.TemporaryDirectory() as folder:
        args = Args(output=Path(folder) / "quick" if quick else Args.output)
        if quick:
            args = replace(args, episodes=4, chunk=4, policies=("pd",))
        held = compare(args)
        others = compare(replace(args, rows=("continuous", "continuous + 1 cm"), programs=("lex",)))
    return {"rows": held + others}


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
        choose("program", program, random_conflicts.PROGRAMS)
    runs = Runs(args.output / "chunks", args.workers, args.backend)
    runs.check()
    open_folder(args.output, {"seed": args.seed, "chunk": args.chunk})
    starts = range(0, args.episodes, args.chunk)
    kinds = list(itertools.product(args.rows, args.policies, args.programs))
    jobs = [
        random_conflicts.Scenes(policy, program, rows, args.seed, start, args.chunk)
        for rows, policy, program in kinds
        for start in starts
    ]
    outcomes = in_order(runs.over(random_conflicts.run, jobs, "chunks"))
    results = []
    for k, (rows, policy, program) in enumerate(kinds):
        mine = range(k * len(starts), (k + 1) * len(starts))
        episodes = [outcome for number in mine for outcome in outcomes[number]][: args.episodes]
        labels = {"rows": rows, "policy": policy, "program": program}
        results.append(labels | random_conflicts.summary(episodes))
    write_json(args.output / "summary.json", results)
    return results


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return who is entered under each kind of rows, and how near strict regions lex gets."""
    results = figures["rows"]
    kinds = dict.fromkeys(r["rows"] for r in results)
    priorities = {
        kind: _priorities(kind, [r for r in results if r["rows"] == kind]) for kind in kinds
    }
    return priorities | {"clearance": _clearance([r for r in results if r["program"] == "lex"])}


def _priorities(kind: str, results: list[dict[str, Any]]) -> Table:
    header = ("policy", "program", f"enters 1 ({BOUNDED})", "2", "3", "4", "depth in 2/3/4 [m]")
    header += ("time in 2/3/4 [s]", "rms ‖u − u*‖", "at the goal", "deadlock", "entered though met")
    rows = [
        (
            r["policy"],
            r["program"],
            _strict(r),
            *(f"{share:.1%}" for share in r["entered"][1:]),
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


def _strict(row: dict[str, Any]) -> str:
    """Return the share that entered rank 1, in which no episode starts, with its bound."""
    share, episodes = row["entered"][0], row["episodes"]
    return f"{share:.1%} ({at_most(round(share * episodes), episodes)})"


def _clearance(results: list[dict[str, Any]]) -> Table:
    header = ("rows", "policy", f"episodes that enter a strict region ({BOUNDED})")
    header += ("least clearance [mm]", "median clearance [mm]")
    rows = [
        (
            r["rows"],
            r["policy"],
            _strict(r),
            f"{1e3 * r['least_clearance']:.2f}",
            f"{1e3 * r['median_clearance']:.2f}",
        )
        for r in results
    ]
    return Table("Clearance from strict regions under lex-cbf-qp", header, rows)
