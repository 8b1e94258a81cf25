"""Plants under attack by the gains of α₂ and of the speed limit's α: bodies that lag keep 2.

``python -m benchmarks.gains --plants a1 cart`` prints a line for each plant and pair of gains, on
the same seeds. Walkers need their data, see `docs/any_walker.md`.
"""

import warnings
from dataclasses import replace

import numpy as np
import tyro
from rich.console import Console

from benchmarks.walkers import ROBOTS
from hcbf_gym.evaluation.attacked import Outcome
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.programs import FilterStatus
from hcbf_lab.certification.command import caps_of
from hcbf_lab.certification.families import HOSTILE, OwnFamily, SceneFamily
from hcbf_robots.walkers.walker import Walker

GAINS = ((2.0, 2.0), (10.0, 2.0), (2.0, 10.0), (10.0, 10.0))
FIRST_SEED = 930_000
SCENES = {
    "a1": ("HCBF-A1Regions-v0", ("random", "random-moving")),
    "model": ("HCBF-Regions-v0", ("random", "random-moving", "random-wide")),
    "model on maps": ("HCBF-Regions-v0", ("random-map",)),
}


def family_of(plant: str) -> SceneFamily | OwnFamily:
    """Return hostile episodes: of `SCENES`, a name in `ROBOTS`, or a ``file.py:function``."""
    if ":" in plant:
        return OwnFamily(plant)
    if plant in SCENES:
        env_id, names = SCENES[plant]
        return SceneFamily(env_id, scenes=tuple((n, 1.0) for n in names), policies=HOSTILE)
    contract = ROBOTS[plant].contract
    caps, options = caps_of(Walker.load(contract)), {"robot": contract}
    return SceneFamily("HCBF-WalkerRegions-v0", options, policies=HOSTILE, caps=caps)


def line(plant: str, gains: tuple[float, float], seen: list[Outcome]) -> dict[str, object]:
    """Return the cells of a line."""
    violated = np.array([one.status_counts[FilterStatus.VIOLATED] for one in seen])
    return {
        "plant": plant, "α₂, α_s [1/s]": "{:g}, {:g}".format(*gains), "episodes": len(seen),
        "entered": sum(one.least_h < 0.0 for one in seen),
        "speed limit passed": sum(one.least_speed_h < 0.0 for one in seen),
        "falls": sum(one.fell for one in seen),
        "VIOLATED episodes": int((violated > 0).sum()), "steps": int(violated.sum()),
    }  # fmt: skip


def main(plants: tuple[str, ...] = ("a1", "cart", "holonomic-cart"), episodes: int = 30) -> None:
    """Run the episodes, and print the table."""
    warnings.simplefilter("ignore")
    rows = []
    for plant in plants:
        attacked = [family_of(plant).episode(FIRST_SEED + k) for k in range(episodes)]
        for gains in GAINS:
            options = dict(zip(("alpha2", "alpha_speed"), gains, strict=True))
            tried = (
                replace(e, filter_options={**(e.filter_options or {}), **options}) for e in attacked
            )
            rows.append(line(plant, gains, [e.run() for e in tried]))
    Console().print(Table("gains", list(rows[0]), [[*map(str, r.values())] for r in rows]).rich())


if __name__ == "__main__":
    tyro.cli(main)
