"""A search for the worst attacker: CMA-ES over its six numbers, maximising the depth."""

import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import track

from hcbf_gym.errors import require
from hcbf_gym.studies.strict.attacks import PARAMETERS
from hcbf_gym.studies.strict.episodes import AttackedEpisode, Outcome

FOLDER = Path("results/strict")
SEED = 7
SECONDS = 8.0
POPULATION = 16


def worst_attack(trials: int) -> dict[str, Any]:
    """Search for the attacker that gets deepest, and return what the worst one did.

    Every trial attacks one scene, chosen by its number, for `SECONDS`. The objective is the least
    strict h of the episode [m].

    Args:
        trials: how many attackers are tried.

    Raises:
        MissingDependencyError: without the extra `studies`.
    """
    require("a search for attacks", "studies", "optuna", "cmaes")
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    sampler = optuna.samplers.CmaEsSampler(seed=SEED, popsize=POPULATION, n_startup_trials=16)
    study = optuna.create_study(sampler=sampler, direction="minimize")
    outcomes: list[Outcome] = []
    with ProcessPoolExecutor() as pool:
        for _ in track(range(0, trials, POPULATION), "search"):
            count = min(POPULATION, trials - len(outcomes))
            asked = [study.ask() for _ in range(count)]
            numbers = [
                tuple(trial.suggest_float(name, 0.0, 1.0) for name in PARAMETERS) for trial in asked
            ]
            episodes = [
                AttackedEpisode(
                    "searched",
                    "random" if trial.number % 2 else "random-moving",
                    60_000 + trial.number % 40,
                    env_options={"max_episode_steps": round(SECONDS / 0.02)},
                    parameters=drawn,
                )
                for trial, drawn in zip(asked, numbers, strict=True)
            ]
            for trial, outcome in zip(asked, pool.map(AttackedEpisode.run, episodes), strict=True):
                study.tell(trial, outcome.least_h)
                outcomes.append(outcome)
    least = np.array([o.least_h for o in outcomes])
    speed = np.array([o.least_speed_h for o in outcomes])
    result = {
        "trials": len(outcomes),
        "entered": int((least < 0.0).sum()),
        "least_h": float(least.min()),
        "speed_passed": int((speed < 0.0).sum()),
        "least_speed_h": float(speed.min()),
        "falls": int(sum(o.fell for o in outcomes)),
        "worst": study.best_params,
    }
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / "search.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return result
