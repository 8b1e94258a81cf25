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
from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_gym.evaluation.rollouts import Case

__all__ = ["run", "tables"]

KEPT = Path("results/policies-on-a1")
"""Finished episodes: a run that was interrupted continues there."""


def run(quick: bool) -> dict[str, Any]:
    """Return the cells of the table."""
    return {"A1": cells(1 if quick else 300, a1_cell)}


def a1_cell(name: str, label: str, episodes: int) -> dict[str, Any]:
    """Return the figures of a policy under a filter on the A1, and where it left strict rows."""
    program, options = FILTERS[label]
    case = Case("HCBF-A1Regions-v0", SCENARIO, name, program, options)
    m = len(PRIORITY)
    seeds = range(FIRST_SEED, FIRST_SEED + episodes)
    summaries = in_order(Runs(KEPT).over(functools.partial(_summary, case), seeds))
    of = {key: np.array([summary[key] for summary in summaries]) for key in summaries[0]}
    strict = of["min_h"][:, :m][:, PRIORITY == 1].min(axis=1)
    over_speed = float(np.maximum(-of["min_h"][:, m:], 0.0).max())
    cases = [[seeds[k], round(float(strict[k]), 4)] for k in np.flatnonzero(strict < 0.0).tolist()]
    return figures_of(of) | {"over_speed_m_s": over_speed, "strict_cases": cases}


def _summary(case: Case, seed: int) -> dict[str, Any]:
    wanted = ("reached", "return", "min_h", "violation_seconds", "intervention_rms")
    summary = case.run(seed).summary()
    return {key: summary[key] for key in (*wanted, "deadlock_share", "fell")}
