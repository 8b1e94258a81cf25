"""Reproduce the paper's figures 5, 6 and 7, and check its claims.

fig5: paths, costs and tracking error over the weights of R- and H-CBF-QP (A1, reduced-order model).
fig6: the A1 between boxes: barriers over time, pictures, contacts over 20 disturbed episodes.
fig7: the A1's paths past the light box, under R and H.

Writes the pictures and reproduction.json, whose `claims` state for each claim of the paper whether
the run confirms it. Run it again to resume it: finished episodes are saved.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import optuna
import tyro
from rich.console import Console
from rich.table import Table

import hcbf_gym
from hcbf_gym.arguments import Folder, Workers
from hcbf_gym.evaluation.jobs import Runs
from hcbf_gym.evaluation.output_folder import open_folder, write_json
from hcbf_gym.evaluation.workers import Backend
from hcbf_lab.reproduction import FIGURES

Figure = Callable[[Runs, Path, bool], dict[str, Any]]
"""(runs, folder, quick) → claims and their data; it draws a figure into the folder."""
RESUMED = "the same command resumes this run"  # printed after Ctrl-C


@dataclass(frozen=True)
class Args:
    """The figures to reproduce, and how their episodes run."""

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
    """Draw the figures, and write and print the claims."""
    names = list(FIGURES) if args.figure == "all" else [args.figure]
    runs = Runs(args.output / "episodes", args.workers, args.backend)
    figures = {name: FIGURES[name] for name in names}
    claims = reproduce(figures, args.output, args.quick, runs)["claims"]
    console = Console()
    console.print(_table(claims))
    console.print(f"written to {args.output}")


def reproduce(
    figures: Mapping[str, Figure], folder: Path, quick: bool, runs: Runs
) -> dict[str, Any]:
    """Draw figures, and return the content of `reproduction.json` for all that the folder has."""
    runs.check()
    settings = {"study": "reproduction", "quick": quick, "version": hcbf_gym.__version__}
    open_folder(folder, settings)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    for name, draw in figures.items():
        write_json(folder / f"{name}.json", draw(runs, folder, quick))
    results: dict[str, dict[str, Any]] = {}
    claims: dict[str, bool] = {}
    for name in FIGURES:
        file = folder / f"{name}.json"
        if file.exists():
            results[name] = json.loads(file.read_text(encoding="utf-8"))
            claims |= results[name]["claims"]
    reproduction = {"settings": settings, "claims": claims, "figures": results}
    write_json(folder / "reproduction.json", reproduction)
    return reproduction


def _table(claims: dict[str, bool]) -> Table:
    table = Table("claim", "holds", title=f"{sum(claims.values())} of {len(claims)} claims hold")
    for text, holds in claims.items():
        table.add_row(text, "[green]yes[/]" if holds else "[red]no[/]")
    return table
