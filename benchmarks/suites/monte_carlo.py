"""The Monte Carlo study as a suite: the tables of docs/programs.md."""

import os
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from hcbf_gym.compilation import sources_hash
from hcbf_gym.studies.monte_carlo.command import Args, compare, tables

__all__ = ["run", "tables"]


def run(quick: bool) -> dict[str, Any]:
    """Return the figures of the suite: held rows everywhere, the others under lex-cbf-qp.

    What a killed run has left is taken up only by the sources that made it.

    Args:
        quick: few scenes, and one policy.
    """
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "quick" if quick else Args.output / sources_hash([Path(__file__)])
        args = Args(output=output, workers=os.cpu_count() or 1)
        if quick:
            args = replace(args, episodes=4, chunk=4, policies=("pd",))
        held = compare(args)
        others = compare(replace(args, rows=("continuous", "continuous + 1 cm"), programs=("lex",)))
    return {"rows": held + others}
