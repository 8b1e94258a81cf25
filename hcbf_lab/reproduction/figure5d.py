"""Panel (d) of figure 5: the cost of an episode under H over the weights (γ₀, Δγ).

The paper's map has a valley: for every Δγ, the cheapest γ₀ is neither small nor large.
"""

from itertools import pairwise
from typing import Any

import numpy as np

from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_gym.evaluation.rollouts import Job
from hcbf_gym.scenarios import Scenario
from hcbf_lab.reproduction.setting import A1
from hcbf_lab.tuning import WINDOW, Problem, Samples
from hcbf_lab.tuning.cost_map import inside

GAMMA0_GRID = (0.05, *np.linspace(0.5, WINDOW["gamma0"], 10).tolist())
DELTA_GAMMA_GRID = np.linspace(0.0, WINDOW["delta_gamma"], 6).tolist()
"""The A1's samples, and the edges of the bands of Δγ in which the cheapest γ₀ is searched."""

LOWEST_INTERIOR, HIGHEST_INTERIOR = 1.0, WINDOW["gamma0"] - 0.25
"""The range of γ₀ in which a valley is interior. It leaves samples of the A1 on both sides, and
ends half a step of its grid below the window's edge."""


def costs_on_a1(runs: Runs, scene: Scenario, options: dict[str, Any]) -> Samples:
    """Return the A1's cost on a grid, because draws from N(µ, Σ) are too few at its edges."""
    problem = Problem(A1, scene, options=options)
    pairs = [(gamma0, delta_gamma) for gamma0 in GAMMA0_GRID for delta_gamma in DELTA_GAMMA_GRID]
    jobs = [Job(problem.case(*pair)) for pair in pairs]
    episodes = in_order(runs.over(Job.run, jobs, "fig 5d, A1"))
    costs = np.array([problem.cost_of(episode) for episode in episodes])
    gamma0, delta_gamma = np.array(pairs).T
    return Samples(gamma0, delta_gamma, costs)


def claims_of(model: str, samples: Samples) -> dict[str, bool]:
    """Return whether the map of the cost on a model shows each claim of the paper."""
    shown = inside(samples)
    valley = _valley(samples)
    is_interior = [
        gamma0 is not None and LOWEST_INTERIOR < gamma0 < HIGHEST_INTERIOR for gamma0 in valley
    ]
    best = float(shown.gamma0[shown.best])
    known = [gamma0 for gamma0 in valley if gamma0 is not None]
    in_valley = bool(known) and min(known) <= best <= max(known)
    return {
        f"fig5d, {model}: the cost map has a valley at interior gamma0, for every delta_gamma": (
            all(is_interior)
        ),
        f"fig5d, {model}: the sampled optimum lies in the valley": in_valley and any(is_interior),
    }


def summary(samples: Samples) -> dict[str, Any]:
    """Return the figures of a map, in JSON types."""
    shown = inside(samples)
    best = shown.best
    return {
        "samples": len(samples.cost),
        "inside_the_window": len(shown.cost),
        "best_gamma0": float(shown.gamma0[best]),
        "best_delta_gamma": float(shown.delta_gamma[best]),
        "least_cost": float(shown.cost[best]),
        "greatest_offset": float(shown.offset.max()),
        "bands_of_delta_gamma": DELTA_GAMMA_GRID,
        "cheapest_gamma0_in_band": _valley(samples),
    }


def _valley(samples: Samples) -> list[float | None]:
    """Return the cheapest γ₀ in each band of Δγ; None if it has no samples beside the interior."""
    shown = inside(samples)
    cheapest: list[float | None] = []
    for low, high in pairwise(DELTA_GAMMA_GRID):
        band = (low <= shown.delta_gamma) & (shown.delta_gamma <= high)
        gamma0 = shown.gamma0[band]
        is_sampled = (gamma0 < LOWEST_INTERIOR).any() and (gamma0 > HIGHEST_INTERIOR).any()
        cheapest.append(float(gamma0[np.argmin(shown.cost[band])]) if is_sampled else None)
    return cheapest
