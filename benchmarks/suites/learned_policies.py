"""Nominal policies under every filter on held-out random scenes of the reduced-order model.

A cell runs as one native batch, which walks as the single environments do.
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from hcbf_gym import policies, scenarios, wrappers
from hcbf_gym.arrays import Array
from hcbf_gym.evaluation.batch import rollout_batch
from hcbf_gym.evaluation.rollouts import SHOWN_OPTIONS, UNFILTERED
from hcbf_gym.evaluation.statistics import BOUNDED, INTERVAL, at_most, shown_share
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.policies import PDTracker, Policy, learned

SCENARIO = "random"
FIRST_SEED = 100_000
"""Neither training nor the choice of the best policies saw scenes of these seeds."""
FILTERS: dict[str, tuple[str, dict[str, Any]]] = {  # label → program and options
    UNFILTERED: (UNFILTERED, {}),
    **{name: (name, SHOWN_OPTIONS.get(name, {})) for name in ("r-cbf-qp", "h-cbf-qp", "eh-cbf-qp")},
    "lex-cbf-qp": ("lex-cbf-qp", {}),
    "lex-cbf-qp, guided": ("lex-cbf-qp", {"guidance": "geodesic"}),
}
PRIORITY = np.array([barrier.priority for barrier in scenarios.make("random").barriers])
_OF = [rank == PRIORITY for rank in (1, 2, 3)]


def run(quick: bool) -> dict[str, Any]:
    """Return the cells of the table."""
    return {"reduced order": cells(20 if quick else 2000, rom_cell)}


def cells(episodes: int, cell: Callable[[str, str, int], dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the cells of policies × filters."""
    pairs = [(name, label) for name in ("pd", *learned.names()) for label in FILTERS]
    return [
        {"policy": name, "filter": label, "episodes": episodes} | cell(name, label, episodes)
        for name, label in track(pairs, "cells")
    ]


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return a table for each of what walks."""
    header = tuple(heading for heading, _ in _COLUMNS)
    return {
        name.replace(" ", "-"): Table(
            f"{name}: held-out random scenes, priorities 1 / 2 / 3",
            ("policy", "filter", *header),
            [(row["policy"], row["filter"], *(text(row) for _, text in _COLUMNS)) for row in rows],
        )
        for name, rows in figures.items()
    }


def _three(values: list[float], scale: float = 1.0, digits: int = 2) -> str:
    return " / ".join(f"{scale * value:.{digits}f}" for value in values)


def _entered(row: dict[str, Any]) -> str:
    n = row["episodes"]
    bound = at_most(round(row["entered"][0] * n), n)
    return f"{_three(row['entered'], 100.0, 1)} ({bound})"


_COLUMNS: tuple[tuple[str, Callable[[dict[str, Any]], str]], ...] = (
    ("scenes", lambda row: f"{row['episodes']:,}"),
    (
        f"success [%, {INTERVAL:.0%} interval]",
        lambda row: shown_share(row["success"], row["episodes"]),
    ),
    ("return", lambda row: f"{row['return']:.1f}"),
    (f"entered [%] (1 {BOUNDED})", lambda row: _entered(row)),
    ("time inside [s]", lambda row: _three(row["seconds_inside"])),
    ("deepest [m]", lambda row: _three(row["deepest_m"], digits=3)),
    ("rms ‖u − u*‖ [m/s²]", lambda row: f"{row['intervention_rms']:.2f}"),
    ("deadlock [%]", lambda row: f"{100.0 * row['deadlock']:.1f}"),
    ("falls [%]", lambda row: f"{100.0 * row['fell']:.0f}"),
)


def rom_cell(name: str, label: str, episodes: int) -> dict[str, Any]:
    """Return the figures of a policy under a filter on the reduced-order model."""
    program, options = FILTERS[label]
    env = gym.make_vec(
        "HCBF-Regions-v0", num_envs=episodes, scenario=SCENARIO, autoreset_mode="Disabled"
    )
    policy: Policy = PDTracker.for_env(env) if name == "pd" else policies.load(name, env)
    if program != UNFILTERED:
        env = wrappers.VectorSafetyFilter(env, program, **options)
    run = rollout_batch(env, policy, FIRST_SEED)
    m = len(PRIORITY)
    return figures_of(
        run.terminated,
        run.reward.sum(axis=0),
        run.min_h[:, :m],
        run.seconds_inside[:, :m],
        run.intervention_rms,
        run.deadlock_share,
        np.zeros(episodes),
    )


def figures_of(
    reached: NDArray[Any],
    returns: Array,
    least: Array,
    inside: Array,
    intervention: Array,
    deadlock: Array,
    fell: NDArray[Any],
) -> dict[str, Any]:
    """Return the figures of a cell from what each of its N episodes recorded."""
    depth = np.maximum(-np.column_stack([least[:, of].min(axis=1) for of in _OF]), 0.0)
    time_in = np.column_stack([inside[:, of].sum(axis=1) for of in _OF])
    return {
        "success": float(reached.mean()),
        "return": float(returns.mean()),
        "entered": (depth > 0.0).mean(axis=0).tolist(),
        "seconds_inside": time_in.mean(axis=0).tolist(),
        "deepest_m": depth.max(axis=0).tolist(),
        "intervention_rms": float(intervention.mean()),
        "deadlock": float(deadlock.mean()),
        "fell": float(fell.mean()),
    }
