"""Train policies on the reduced-order model with a safety filter in the loop, or without one.

The folder of each seed has policy.npz, which `hcbf evaluate --policy` takes, training.json and a
checkpoint. curves.png and curves.json have the learning curves of all seeds. Needs the extra `rl`.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import tyro
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import Progress, TimeElapsedColumn

from hcbf_gym.arguments import Count, Folder
from hcbf_gym.errors import InvalidInputError, require
from hcbf_gym.evaluation.output_folder import write_json
from hcbf_gym.training import TrainingConfig, checkpoint, train
from hcbf_gym.training.config import Curve

RESUMED = "the same command with --resume continues from the last checkpoint"
"""Printed after Ctrl-C."""


@dataclass(frozen=True)
class Args:
    """The training runs, and where their results are saved."""

    config: tyro.conf.OmitArgPrefixes[TrainingConfig] = field(default_factory=TrainingConfig)
    """The run; its seed is the first of `seeds`."""
    seeds: Count = 1
    """Runs with the seeds seed, seed + 1, …"""
    output: Folder = Path("results/train")
    """Folder; each run has a subfolder of it."""
    resume: bool = False
    """Continue from each run's checkpoint, if there is one."""
    tensorboard: bool = False
    """Log to the run's subfolder `tensorboard`, the filter's interventions included."""


def main(args: Args) -> None:
    """Train with every seed and draw the learning curves."""
    if args.tensorboard:
        require("--tensorboard", "rl", "tensorboard")
    seeds = range(args.config.seed, args.config.seed + args.seeds)
    folders = {seed: args.output / f"seed-{seed}" for seed in seeds}
    for folder in folders.values():
        if checkpoint.find(folder) is not None and not args.resume:
            raise InvalidInputError(
                f"output: {folder} holds a run, expected --resume or another --output"
            )
    curves = {f"seed {seed}": _train_seed(args, seed, folders[seed]) for seed in seeds}
    write_json(args.output / "curves.json", curves)
    plot_curves(curves, args.output / "curves.png")
    Console().print(f"policies and curves in {args.output}")


def _train_seed(args: Args, seed: int, folder: Path) -> Curve:
    """Train with one seed under a progress bar, and return the learning curve."""
    config = replace(args.config, seed=seed)
    with Progress(*Progress.get_default_columns(), TimeElapsedColumn()) as progress:
        bar = progress.add_task(f"seed {seed}", total=config.total_steps)

        def show(steps: int, curve: Curve) -> None:
            success = f", held-out success {curve[-1]['success']:.1%}" if curve else ""
            progress.update(bar, completed=steps, description=f"seed {seed}{success}")

        train(config, folder, args.resume, args.tensorboard, show)
    text = (folder / "training.json").read_text(encoding="utf-8")
    return json.loads(text)["curve"]


def plot_curves(curves: Mapping[str, Curve], path: Path) -> None:
    """Draw the success of each labelled run over its decisions, and over the time they took."""
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    by_steps, by_time = figure.subplots(1, 2, sharey=True)
    for name, curve in curves.items():
        success = [100.0 * point["success"] for point in curve]
        by_steps.plot([point["steps"] / 1e6 for point in curve], success, ".-", label=name)
        by_time.plot([point["seconds_spent"] / 60.0 for point in curve], success, ".-", label=name)
    by_steps.set(xlabel="decisions [million]", ylabel="held-out scenes solved [%]", ylim=(0, 102))
    by_time.set(xlabel="time [min]")
    for axes in (by_steps, by_time):
        axes.axhline(95.0, color="0.6", linewidth=0.8, linestyle="--")
        axes.grid(alpha=0.3)
    by_steps.legend()
    figure.savefig(path, dpi=110)
