"""Attacks on the A1 with one argument that a certificate leaves out: what `tested.json` rests on.

``python -m benchmarks.alone`` prints a line for each end of a range that was tested alone. Finished
episodes are kept in ``results/alone``: a run that was interrupted continues there.
"""

from pathlib import Path
from typing import Any

import tyro
from rich.console import Console

from benchmarks.strict.lines import BOTH, Line
from benchmarks.strict.suite import outcomes, summaries, summary
from hcbf_gym.evaluation.attacks import ATTACKS

PUSHES = {"kind": "random", "interval": 2.0, "impulse": [2.0, 2.0]}
ALONE: dict[str, dict[str, Any]] = {
    "feedback rom": {"feedback": "rom"},
    "timestep .001": {"timestep": 0.001},
    "timestep .005": {"timestep": 0.005},
    "friction .3": {"friction": 0.3},
    "friction .45": {"friction": 0.45},
    "pushes of 2 N·s": {"disturbances": PUSHES},
}
"""The ends of the ranges; scenes have a cap of 1 m/s themselves."""


def main(seeds: int = 3, only: str = "") -> None:
    """Run what is missing, and print the table.

    Args:
        seeds: of each attack in each family of scenes.
        only: the lines whose name has this in it.
    """
    groups = []
    for name, options in ALONE.items():
        if only in name:
            line = Line("alone", name, tuple(ATTACKS), seeds, BOTH, options)
            seen = outcomes(line.episodes(quick=False), Path("results/alone"), title=name)
            groups.append({"section": line.section, "name": name} | summary(seen))
    Console().print(summaries("one argument beyond the mixture", groups, {}).rich())


if __name__ == "__main__":
    tyro.cli(main)
