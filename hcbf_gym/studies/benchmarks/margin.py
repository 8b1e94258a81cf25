"""How far the A1 dips below what its strict rows keep: the ground of the default margin."""

from typing import Any

import joblib
import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from hcbf_gym import policies
from hcbf_gym.evaluation.rollouts import Case, rollout
from hcbf_gym.evaluation.tables import Table

MARGINS = (0.0, 0.03)
FEEDBACKS = ("measured", "position", "rom")
NOISE = 2.0
"""Standard deviation of what is added to the PD policy at every step [m/s²]."""


def run(quick: bool) -> dict[str, Any]:
    """Walk random scenes under lex-cbf-qp; return the least strict h of every setting."""
    episodes = 4 if quick else 40
    settings = [
        (margin, feedback, noise)
        for feedback in FEEDBACKS
        for noise in (0.0, NOISE)
        for margin in MARGINS
    ]
    parallel = joblib.Parallel(n_jobs=-1, return_as="generator")
    jobs = [(*setting, seed) for setting in settings for seed in range(episodes)]
    runs = parallel(joblib.delayed(least_strict_h)(*job) for job in jobs)
    least = np.array(list(track(runs, "episodes", total=len(jobs)))).reshape(len(settings), -1)
    rows = []
    for (margin, feedback, noise), values in zip(settings, least, strict=True):
        entered = int((values < 0.0).sum())
        rows.append(
            {
                "feedback": feedback,
                "noise": noise,
                "margin": margin,
                "least_h": float(values.min()),
                "entered": entered,
                "episodes": episodes,
            }
        )
    return {"margin": rows}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the least strict h of every setting."""
    rows = figures["margin"]
    header = ("feedback", "noise added to u* [m/s²]", "margin [m]", "least strict h [m]")
    cells = [
        (
            row["feedback"],
            f"{row['noise']:.0f}",
            f"{row['margin']:.2f}",
            f"{row['least_h']:+.4f}",
            str(row["entered"]),
        )
        for row in rows
    ]
    count = rows[0]["episodes"]
    title = f"least strict h on the A1, lex-cbf-qp, {count} random scenes each"
    return {"all": Table(title, (*header, f"scenes entered, of {count}"), cells)}


def least_strict_h(margin: float, feedback: str, noise: float, seed: int) -> float:
    """Return the least h of the scenario's strict barriers over the physics steps of an episode."""
    case = Case(
        "HCBF-A1Regions-v0",
        "random",
        "pd",
        "lex-cbf-qp",
        {"margin": margin},
        {"feedback": feedback},
    )
    env = case.make()
    tracker = policies.PDTracker.for_env(env)
    rng = np.random.default_rng(seed)

    def policy(observation: NDArray[np.float64], info: dict[str, Any]) -> NDArray[np.float64]:
        u = tracker(observation, info) + noise * rng.standard_normal(2)
        return np.clip(u, tracker.low, tracker.high)

    episode = rollout(env, policy, seed)
    scenario: Any = env.unwrapped
    strict = [k for k, b in enumerate(scenario.scenario.barriers) if b.priority == 1]
    env.close()
    return float(episode.min_h[:, strict].min())
