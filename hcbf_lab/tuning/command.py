"""Choose the weights (γ₀, Δγ) by sampling: draws, the cost of each, the cheapest pair, the map.

Without arguments it repeats the paper's section III-C on the reduced-order model: draws from
N((3, 1.5), I) without negative ones. Run it again to resume it, or with more samples to extend it.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeElapsedColumn
from rich.table import Table

from hcbf_gym.arguments import Amount, Count, Folder, Seed, Workers
from hcbf_gym.errors import require
from hcbf_gym.evaluation.jobs import Runs
from hcbf_gym.evaluation.output_folder import check_folder, open_folder, write_json
from hcbf_gym.evaluation.workers import Backend
from hcbf_lab.tuning import Cost, Normal, Problem, Samples, TuningStudy
from hcbf_lab.tuning.cost_map import inside, plot_cost_map, plot_samplers

RESUMED = "the same command resumes this run"  # printed after Ctrl-C


@dataclass(frozen=True)
class Args:
    """The problem to tune, and the sampling."""

    env: Literal["HCBF-Regions-v0", "HCBF-A1Regions-v0"] = "HCBF-Regions-v0"
    """The reduced-order model, all samples at once, or full physics, one episode each."""
    scenario: str = "paper-simulation"
    """A name from hcbf_gym.scenarios.names(), or a path to a JSON file."""
    program: str = "h-cbf-qp"
    """A program that takes both weights."""
    sampler: tuple[Literal["normal", "tpe", "cmaes"], ...] = ("normal",)
    """The paper's plain sampling, or Optuna's TPE and CMA-ES within [0, 5] x [0, 2.5]."""
    samples: Count = 500
    """Samples of each sampler."""
    mean: tuple[float, float] = (3.0, 1.5)
    """µ of (γ₀, Δγ)."""
    covariance: tuple[tuple[float, float], tuple[float, float]] = ((1.0, 0.0), (0.0, 1.0))
    """Σ of (γ₀, Δγ), row by row."""
    w_i: Amount = 1.0
    """Weight of the tracking error before the end."""
    w_f: Amount = 1000.0
    """Weight of the tracking error at the end."""
    w_delta: Amount = 0.5
    """Weight of the relaxation."""
    seed: Seed = 0
    """Decides the samples and the episodes."""
    workers: Workers | None = None
    """Episodes that run at once, in full physics [default: as many as the backend has CPUs]."""
    backend: Backend = "processes"
    """Where they run; ray needs the extra `cluster`."""
    output: Folder = Path("results/tune")
    """Folder for the study, tuning.json and the maps."""


def main(args: Args) -> None:
    """Sample the weights, and write and print the results."""
    runs = Runs(None, args.workers, args.backend)
    runs.check()
    if "cmaes" in args.sampler:
        require("--sampler cmaes", "studies", "cmaes")
    cost = Cost(args.w_i, args.w_f, args.w_delta)
    problem = Problem(args.env, args.scenario, args.program, seed=args.seed, cost=cost)
    normal = Normal(args.mean, args.covariance)
    settings = {"study": "tuning", "problem": problem.settings(), "seed": args.seed}
    settings |= {"mean": args.mean, "covariance": args.covariance, "samplers": args.sampler}
    check_folder(args.output, settings)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    open_folder(args.output, settings)
    log = args.output / "study.log"
    _cut_unfinished_line(log)
    storage = JournalStorage(JournalFileBackend(str(log)))
    columns = (*Progress.get_default_columns(), MofNCompleteColumn(), TimeElapsedColumn())
    studies, seconds = {}, {}
    with Progress(*columns) as progress:
        for name in args.sampler:
            bar = progress.add_task(name, total=args.samples)
            study = TuningStudy(problem, normal, name, args.seed, storage)
            start = time.perf_counter()
            advance = lambda done, bar=bar: progress.update(bar, completed=done)  # noqa: E731
            studies[name] = study, study.run(args.samples, runs, advance)
            seconds[name] = time.perf_counter() - start
    _write(args, settings, studies)
    console = Console()
    console.print(_table(args, studies))
    for name, value in seconds.items():
        console.print(f"{name}: {args.samples} samples in {value:.1f} s")
    console.print(f"written to {args.output}")


def _cut_unfinished_line(log: Path) -> None:
    """Cut the unfinished last line of a killed run from a log, as Optuna would append to it."""
    content = log.read_bytes() if log.exists() else b""
    if content and not content.endswith(b"\n"):
        log.write_bytes(content[: content.rfind(b"\n") + 1])


def _write(
    args: Args, settings: dict[str, Any], studies: dict[str, tuple[TuningStudy, Samples]]
) -> None:
    """Write tuning.json and the figures; a map needs four samples inside the window."""
    results = {
        name: {
            "samples": args.samples,
            "rejected": study.rejected(args.samples),
            "best": _best(samples),
            "gamma0": samples.gamma0.tolist(),
            "delta_gamma": samples.delta_gamma.tolist(),
            "cost": [_number(cost) for cost in samples.cost.tolist()],
        }
        for name, (study, samples) in studies.items()
    }
    write_json(args.output / "tuning.json", {"settings": settings, "samplers": results})
    for name, (_, samples) in studies.items():
        if len(inside(samples).cost) >= 4:
            plot_cost_map(samples).savefig(args.output / f"map-{name}.png")
    if len(studies) > 1:
        curves = {name: samples for name, (_, samples) in studies.items()}
        plot_samplers(curves).savefig(args.output / "samplers.png")


def _best(samples: Samples) -> dict[str, float | None]:
    """Return number, weights and cost of the cheapest sample, for JSON."""
    k = samples.best
    return {
        "number": k,
        "gamma0": float(samples.gamma0[k]),
        "delta_gamma": float(samples.delta_gamma[k]),
        "cost": _number(float(samples.cost[k])),
    }


def _number(cost: float) -> float | None:
    """Return a cost for JSON, which has no infinity: None if the robot fell."""
    return cost if cost < float("inf") else None


def _table(args: Args, studies: dict[str, tuple[TuningStudy, Samples]]) -> Table:
    table = Table(title=f"{args.env}, {args.scenario}, {args.program}, {args.samples} samples each")
    for column in ("sampler", "γ₀", "Δγ", "least r", "at sample", "negative draws rejected"):
        table.add_column(column, justify="left" if column == "sampler" else "right")
    for name, (study, samples) in studies.items():
        best = _best(samples)
        table.add_row(
            name,
            f"{best['gamma0']:.3f}",
            f"{best['delta_gamma']:.3f}",
            "fell" if best["cost"] is None else f"{best['cost']:.2f}",
            f"{best['number']}",
            f"{study.rejected(args.samples)}" if name == "normal" else "-",
        )
    return table
