"""Nominal policies under every filter on held-out random scenes of the reduced-order model.

A cell runs as one native batch, which walks as the single environments do. `policies_on_a1` has the
same policies on the A1.
"""

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from benchmarks.common import table
from hcbf_gym import policies, scenarios, wrappers
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
    """Return the figures of (policy, filter, episodes) of policies × filters."""
    pairs = [(name, label) for name in ("pd", *learned.names()) for label in FILTERS]
    return [
        {"policy": name, "filter": label, "episodes": episodes} | cell(name, label, episodes)
        for name, label in track(pairs, "cells")
    ]


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return a table for each of what walks."""

    def three(key: str, scale: float = 1.0, digits: int = 2) -> Callable[[Any], str]:
        return lambda row: " / ".join(f"{scale * value:.{digits}f}" for value in row[key])

    def bound(row: Any) -> str:
        return at_most(round(row["entered"][0] * row["episodes"]), row["episodes"])

    columns: Any = {
        "policy": "{policy}", "filter": "{filter}", "scenes": "{episodes:,}",
        f"success [%, {INTERVAL:.0%} interval]": lambda row: shown_share(
            row["success"], row["episodes"]
        ),
        "return": "{return:.1f}",
        f"entered [%] (1 {BOUNDED})": lambda row: (
            f"{three('entered', 100.0, 1)(row)} ({bound(row)})"
        ),
        "time inside [s]": three("seconds_inside"), "deepest [m]": three("deepest_m", digits=3),
        "rms ‖u − u*‖ [m/s²]": "{intervention_rms:.2f}",
        "deadlock [%]": lambda row: f"{100.0 * row['deadlock']:.1f}",
        "falls [%]": lambda row: f"{100.0 * row['fell']:.0f}",
    }  # fmt: skip
    return {
        name.replace(" ", "-"): table(
            f"{name}: held-out random scenes, priorities 1 / 2 / 3", rows, columns
        )
        for name, rows in figures.items()
    }


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
    return figures_of({
        "reached": run.terminated, "return": run.reward.sum(axis=0), "min_h": run.min_h,
        "violation_seconds": run.seconds_inside, "intervention_rms": run.intervention_rms,
        "deadlock_share": run.deadlock_share, "fell": np.zeros(episodes),
    })  # fmt: skip


def figures_of(of: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return the figures of a cell from (N, …) entries of its episodes' summaries."""
    least, inside = (of[key][:, : len(PRIORITY)] for key in ("min_h", "violation_seconds"))
    depth = np.maximum(-np.column_stack([least[:, rank].min(axis=1) for rank in _OF]), 0.0)
    time_in = np.column_stack([inside[:, rank].sum(axis=1) for rank in _OF])
    return {
        "success": float(of["reached"].mean()),
        "return": float(of["return"].mean()),
        "entered": (depth > 0.0).mean(axis=0).tolist(),
        "seconds_inside": time_in.mean(axis=0).tolist(),
        "deepest_m": depth.max(axis=0).tolist(),
        "intervention_rms": float(of["intervention_rms"].mean()),
        "deadlock": float(of["deadlock_share"].mean()),
        "fell": float(of["fell"].mean()),
    }
