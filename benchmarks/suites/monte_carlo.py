"""The Monte Carlo study as a suite: the tables of docs/programs.md."""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from hcbf_gym.studies.monte_carlo.command import Args, compare, tables

__all__ = ["run", "tables"]


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
