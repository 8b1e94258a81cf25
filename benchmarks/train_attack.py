"""Trains the attack "trained" by CMA-ES on the walking A1, and writes its parameters.

``python -m benchmarks.train_attack`` is the command that made what the package ships. The episodes
of the search are no independent draws, and nothing is certified by them; those of the trained
attack on fresh seeds are draws like those of any other policy.
"""

from pathlib import Path

import numpy as np
import tyro
from rich.progress import track

from hcbf_gym.errors import require
from hcbf_gym.evaluation.attacked import AttackedEpisode
from hcbf_gym.evaluation.attacks import N_TRAINED, TRAINED
from hcbf_gym.evaluation.jobs import Runs
from hcbf_gym.evaluation.output_folder import write_json

SEED = 11
FIRST_SEED = 12_000_000
FAMILIES = ("random", "random-moving")
SECONDS = 8.0
POPULATION = 16
SPREAD = 0.5


def least_h(episode: AttackedEpisode) -> float:
    """Return the least strict h of an episode [m]."""
    return episode.run().least_h


def main(generations: int = 21, scenes: int = 2, output: Path = TRAINED) -> None:
    """Search, and write the mean of the last generation.

    The attackers of a generation meet the same scenes, the next generation others; what they
    lower is the mean of the least strict h over the scenes.

    Args:
        generations: of 16 attackers each.
        scenes: that every attacker meets.
        output: where the parameters go.
    """
    require("benchmarks.train_attack", "studies", "cmaes")
    from cmaes import CMA

    nearest = np.zeros(N_TRAINED)
    nearest[0] = 1.0  # straight at the nearest region
    search = CMA(mean=nearest, sigma=SPREAD, population_size=POPULATION, seed=SEED)
    means: list[float] = []
    for generation in track(range(generations), "generations"):
        asked = [search.ask() for _ in range(POPULATION)]
        first = FIRST_SEED + generation * scenes
        jobs = [
            AttackedEpisode(
                "trained",
                FAMILIES[seed % len(FAMILIES)],
                seed,
                env_options={"max_episode_steps": round(SECONDS / 0.02)},
                parameters=tuple(parameters.tolist()),
            )
            for parameters in asked
            for seed in range(first, first + scenes)
        ]
        found = dict(Runs(Path("results/train-attack")).over(least_h, jobs))
        least = np.array([found[k] for k in range(len(jobs))]).reshape(POPULATION, scenes)
        search.tell(list(zip(asked, least.mean(axis=1).tolist(), strict=True)))
        means.append(float(least.mean()))
    write_json(
        output,
        {
            "command": f"python -m benchmarks.train_attack --generations {generations} "
            f"--scenes {scenes}",
            "parameters": [round(float(x), 4) for x in search.mean],
        },
    )
    print(
        f"mean of the least h: {means[0]:+.4f} m in the first generation, {means[-1]:+.4f} m last"
    )


if __name__ == "__main__":
    from benchmarks import train_attack  # under its own name, by which workers find it

    tyro.cli(train_attack.main)
