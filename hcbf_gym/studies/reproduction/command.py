"""The paper's figures 5, 6 and 7, on the reduced-order model and the A1, and its claims.

Writes the pictures and reproduction.json, whose `claims` say for each claim of the paper whether
the run bears it out. Run it again to resume it: every episode is kept under its settings.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import optuna
import tyro
from rich.console import Console
from rich.table import Table

import hcbf_gym
from hcbf_gym.arguments import Folder, Workers
from hcbf_gym.evaluation.chunks import Runs
from hcbf_gym.evaluation.output_folder import open_folder, write_json
from hcbf_gym.evaluation.workers import Backend
from hcbf_gym.studies.reproduction import FIGURES

GOES_ON = "the same command goes on where this one stopped"
"""What Ctrl-C says besides."""


@dataclass(frozen=True)
class Args:
    """What to reproduce."""

    figure: tyro.conf.Positional[Literal["fig5", "fig6", "fig7", "all"]] = "all"
    """Which figure of the paper."""
    quick: bool = False
    """Fewer episodes: no cost map on the A1, four seeds instead of twenty."""
    output: Folder = Path("results/reproduce")
    """Folder for the pictures, the episodes and reproduction.json."""
    workers: Workers | None = None
    """Episodes that run at once [default: as many as the backend has CPUs]."""
    backend: Backend = "processes"
    """Where they run; ray needs the extra `cluster`."""


def main(args: Args) -> None:
    """Draw the figures, check the claims, and write both."""
    names = list(FIGURES) if args.figure == "all" else [args.figure]
    runs = Runs(args.output / "episodes", args.workers, args.backend)
    claims = reproduce(names, args.output, args.quick, runs)["claims"]
    console = Console()
    console.print(_table(claims))
    console.print(f"written to {args.output}")


def reproduce(names: Sequence[str], folder: Path, quick: bool, runs: Runs) -> dict[str, Any]:
    """Draw figures into a folder, and return what `reproduction.json` holds then.

    Args:
        names: of `FIGURES`.
        folder: for the pictures and the JSON; figures that it has stay.
        quick: fewer episodes.
        runs: how episodes run.
    """
    runs.check()
    settings = {"study": "reproduction", "quick": quick, "version": hcbf_gym.__version__}
    open_folder(folder, settings)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    for name in names:
        write_json(folder / f"{name}.json", FIGURES[name](runs, folder, quick))
    results = {
        name: json.loads(path.read_text(encoding="utf-8"))
        for name in FIGURES
        if (path := folder / f"{name}.json").exists()
    }
    claims = {
        text: holds for result in results.values() for text, holds in result["claims"].items()
    }
    reproduction = {"settings": settings, "claims": claims, "figures": results}
    write_json(folder / "reproduction.json", reproduction)
    return reproduction


def _table(claims: dict[str, bool]) -> Table:
    table = Table("claim", "holds", title=f"{sum(claims.values())} of {len(claims)} claims hold")
    for text, holds in claims.items():
        table.add_row(text, "[green]yes[/]" if holds else "[red]no[/]")
    return table
