"""The same policies on the A1, as they were trained on the reduced order."""

import functools
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.suites.learned_policies import (
    FILTERS,
    FIRST_SEED,
    PRIORITY,
    SCENARIO,
    cells,
    figures_of,
    tables,
)
from hcbf_gym.arrays import Array
from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_gym.evaluation.rollouts import Case

__all__ = ["run", "tables"]

KEPT = Path("results/policies-on-a1")
"""Finished episodes: a run that was interrupted goes on where it stopped."""


def run(quick: bool) -> dict[str, Any]:
    """Return the cells of the table.

    Args:
        quick: one scene.
    """
    return {"A1": cells(1 if quick else 300, a1_cell)}


def a1_cell(name: str, label: str, episodes: int) -> dict[str, Any]:
    """Return the figures of a policy under a filter on the A1, and where it left strict rows."""
    program, options = FILTERS[label]
    case = Case("HCBF-A1Regions-v0", SCENARIO, name, program, options)
    m = len(PRIORITY)
    seeds = range(FIRST_SEED, FIRST_SEED + episodes)
    summaries = in_order(Runs(KEPT).over(functools.partial(_summary, case), seeds))
    least: Array = np.array([summary["min_h"] for summary in summaries])
    inside = np.array([summary["violation_seconds"] for summary in summaries])
    figures = figures_of(
        np.array([summary["reached"] for summary in summaries]),
        np.array([summary["return"] for summary in summaries]),
        least[:, :m],
        inside[:, :m],
        np.array([summary["intervention_rms"] for summary in summaries]),
        np.array([summary["deadlock_share"] for summary in summaries]),
        np.array([summary["fell"] for summary in summaries]),
    )
    strict = least[:, :m][:, PRIORITY == 1].min(axis=1)
    figures["over_speed_m_s"] = float(np.maximum(-least[:, m:], 0.0).max())
    figures["strict_cases"] = [
        [seeds[k], round(float(strict[k]), 4)] for k in np.flatnonzero(strict < 0.0).tolist()
    ]
    return figures


def _summary(case: Case, seed: int) -> dict[str, Any]:
    return case.run(seed).summary()
