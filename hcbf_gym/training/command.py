"""Train policies on the reduced-order model with a safety filter in the loop, or without one.

Each seed leaves policy.npz, which `hcbf evaluate --policy` takes, training.json and a
checkpoint in its folder; curves.png and curves.json show all seeds. Needs the extra `rl`.
"""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path

import tyro
from rich.console import Console
from rich.progress import Progress, TimeElapsedColumn

from hcbf_gym.arguments import Count, Folder
from hcbf_gym.errors import require
from hcbf_gym.evaluation.output_folder import write_json
from hcbf_gym.training import TrainingConfig, train
from hcbf_gym.training.curves import plot_curves

RESUMED = "the same command with --resume continues from the last checkpoint"
"""Printed after Ctrl-C."""


@dataclass(frozen=True)
class Args:
    """What to train, and where to leave it."""

    config: tyro.conf.OmitArgPrefixes[TrainingConfig] = field(default_factory=TrainingConfig)
    """The run; its seed is the first of `seeds`."""
    seeds: Count = 1
    """Runs with the seeds seed, seed + 1, …"""
    output: Folder = Path("results/train")
    """Folder; each run has a subfolder of it."""
    resume: bool = False
    """Go on from each run's checkpoint, if there is one."""
    tensorboard: bool = False
    """Log to the run's subfolder `tensorboard`, what the filter did included."""


def main(args: Args) -> None:
    """Train with every seed and draw the learning curves."""
    if args.tensorboard:
        require("--tensorboard", "rl", "tensorboard")
    curves = {}
    for seed in range(args.config.seed, args.config.seed + args.seeds):
        config, folder = replace(args.config, seed=seed), args.output / f"seed-{seed}"
        with Progress(*Progress.get_default_columns(), TimeElapsedColumn()) as progress:
            bar = progress.add_task(f"seed {seed}", total=config.total_steps)

            def show(steps: int, curve: list[dict[str, float]]) -> None:
                success = f", held-out success {curve[-1]['success']:.1%}" if curve else ""
                progress.update(bar, completed=steps, description=f"seed {seed}{success}")  # noqa: B023

            train(config, folder, args.resume, args.tensorboard, show)
        text = (folder / "training.json").read_text(encoding="utf-8")
        curves[f"seed {seed}"] = json.loads(text)["curve"]
    write_json(args.output / "curves.json", curves)
    plot_curves(curves, args.output / "curves.png")
    Console().print(f"policies and curves in {args.output}")
