"""A search for the worst attacker: CMA-ES over its six numbers, maximising the depth."""

from collections.abc import Callable
from typing import Any

import numpy as np
from rich.progress import track

from benchmarks.common import table
from hcbf_gym.errors import require
from hcbf_gym.evaluation.attacked import AttackedEpisode, Outcome
from hcbf_gym.evaluation.attacks import PARAMETERS
from hcbf_gym.evaluation.tables import Table

SEED = 7
FIRST_SEED = 90_000
FAMILIES = ("random", "random-moving")
SECONDS = 8.0
POPULATION = 16


def worst_attack(trials: int, kept: Callable[..., Any]) -> dict[str, Any]:
    """Search for the attacker that gets deepest, and return what all of them did.

    The attackers of one generation meet the same scene for `SECONDS`, the next generation another:
    CMA-ES compares within a generation alone. The objective is the least strict h of the episode
    [m].
    """
    require("a search for attacks", "studies", "optuna", "cmaes")
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    sampler = optuna.samplers.CmaEsSampler(
        seed=SEED, popsize=POPULATION, n_startup_trials=POPULATION
    )
    study = optuna.create_study(sampler=sampler, direction="minimize")
    outcomes: list[Outcome] = []
    for generation in track(range(-(-trials // POPULATION)), "search"):
        asked = [study.ask() for _ in range(min(POPULATION, trials - len(outcomes)))]
        episodes = [
            AttackedEpisode(
                "searched",
                FAMILIES[generation % 2],
                FIRST_SEED + generation,
                env_options={"max_episode_steps": round(SECONDS / 0.02)},
                parameters=tuple(trial.suggest_float(name, 0.0, 1.0) for name in PARAMETERS),
            )
            for trial in asked
        ]
        found = kept(episodes)
        for trial, outcome in zip(asked, found, strict=True):
            study.tell(trial, outcome.least_h)
        outcomes.extend(found)
    least = np.array([o.least_h for o in outcomes])
    speed = np.array([o.least_speed_h for o in outcomes])
    return {
        "trials": len(outcomes),
        "entered": int((least < 0.0).sum()),
        "least_h": float(least.min()),
        "speed_passed": int((speed < 0.0).sum()),
        "least_speed_h": float(speed.min()),
        "falls": int(sum(o.fell for o in outcomes)),
        "qp_failures": int(sum(o.qp_failures for o in outcomes)),
        "worst": study.best_params,
    }


def tables(found: dict[str, Any]) -> Table:
    """Return what the search found; no bound follows from attackers that are no random draws."""
    columns = {
        "search": "CMA-ES", "attackers tried": "{trials}", "of these entered": "{entered}",
        "least h [m]": "{least_h:+.3f}", "falls": "{falls}", "speed limit passed": "{speed_passed}",
        "by at most [m/s]": lambda f: f"{max(0.0, -f['least_speed_h']):.3f}",
        "QP failures": "{qp_failures}",
    }  # fmt: skip
    return table("searched attackers: they find failures, and bound nothing", [found], columns)
