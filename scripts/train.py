"""Train policies on the reduced-order model with a safety filter in the loop, or without one.

Each seed leaves policy.npz, which scripts/evaluate.py --policy takes, training.json and a
checkpoint in its folder; curves.png and curves.json show all seeds. Needs the extra `rl`.
"""

import json
import os
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # the networks are small

import tyro
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress, TimeElapsedColumn

from hcbf_gym.errors import HcbfError
from hcbf_gym.studies.training import TrainingConfig, train
from hcbf_gym.studies.training.curves import plot_curves


@dataclass(frozen=True)
class Args:
    """What to train, and where to leave it."""

    config: tyro.conf.OmitArgPrefixes[TrainingConfig] = field(default_factory=TrainingConfig)
    """The run; its seed is the first of `seeds`."""
    seeds: int = 1
    """Runs with the seeds seed, seed + 1, …"""
    output: Path = Path("results/train")
    """Folder; each run has a subfolder of it."""
    resume: bool = False
    """Go on from each run's checkpoint, if there is one."""
    tensorboard: bool = False
    """Log to the run's subfolder `tensorboard`."""


def main(args: Args) -> None:
    """Train with every seed and draw the learning curves."""
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
    (args.output / "curves.json").write_text(json.dumps(curves, indent=1), encoding="utf-8")
    plot_curves(curves, args.output / "curves.png")
    Console().print(f"policies and curves in {args.output}")


if __name__ == "__main__":
    try:
        main(tyro.cli(Args, description=__doc__))
    except HcbfError as error:
        Console(stderr=True).print(f"[red]{escape(str(error))}[/red]")
        sys.exit(2)
