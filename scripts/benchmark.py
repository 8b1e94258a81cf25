"""Measure speed and quality, beside others where they are installed; medians of several runs.

Every suite prints its table and leaves a JSON of the figures in the output folder.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # figures are for one core
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import importlib
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from hcbf_gym.errors import HcbfError

SUITES = {
    "programs": "hcbf_gym.studies.benchmarks.programs",
    "verify-programs": "hcbf_gym.studies.benchmarks.verify_programs",
    "environments": "hcbf_gym.studies.benchmarks.environments",
    "learned-policies": "hcbf_gym.studies.benchmarks.learned_policies",
    "locomotion": "hcbf_gym.studies.benchmarks.locomotion",
    "margin": "hcbf_gym.studies.benchmarks.margin",
}


@dataclass(frozen=True)
class Args:
    """Which figures to make."""

    suite: Literal[
        "programs", "verify-programs", "environments", "learned-policies", "locomotion", "margin"
    ]
    """programs: time of each filter; verify-programs: each filter against exact solutions;
    environments: steps per second; learned-policies: success and safety under every program on the
    reduced order and on the A1 (half an hour and more); locomotion: quality, robustness and speed
    of the walk; margin: how far the walking robot dips below what its strict rows keep."""
    quick: bool = False
    """Fewer and shorter runs."""
    output: Path = Path("results/benchmark")
    """Folder for SUITE.json."""


def main(args: Args) -> None:
    """Run one suite, `run(quick) -> figures` of its module, and save the figures."""
    args.output.mkdir(parents=True, exist_ok=True)
    figures = importlib.import_module(SUITES[args.suite]).run(args.quick)
    path = args.output / f"{args.suite}.json"
    path.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    print(f"written to {path}")


if __name__ == "__main__":
    try:
        main(tyro.cli(Args, description=__doc__))
    except HcbfError as error:
        sys.exit(f"error: {error}")
