"""Figure 5: safer weights cost tracking, in the paper's simulation.

The reference crosses region 1 (barrier h₃, strict) and region 2 (barrier h₄, relaxed). The figure
compares R-CBF-QP (R), H-CBF-QP (H) for several weights γ₀, and H with too large weights. It does so
on two models: the double integrator (ROM, the reduced-order model) and the A1 in full physics.
Panels: (a) the position over time, on the ROM for H over the weights that the paper samples,
(b) h₃ and h₄ over time, (c) the tracking error over time, (d) the cost of an episode over the
weights, and (e) the paths from above.
"""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym import scenarios
from hcbf_gym.envs.a1_plant import FASTEST
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_gym.evaluation.rollouts import Episode, Job
from hcbf_gym.scenarios import Scenario
from hcbf_lab.reproduction import plots
from hcbf_lab.reproduction.film import draw_frames
from hcbf_lab.reproduction.setting import A1, H3, H4, ROM, Setting, of_role
from hcbf_lab.tuning import WINDOW, Normal, Problem, Samples, Trajectories, TuningStudy, simulate
from hcbf_lab.tuning.cost_map import inside
from hcbf_lab.tuning.problem import ALPHAS

SCENE = "paper-simulation"
GAMMAS = (1.0, 2.0, 3.0, 4.0, 5.0)
"""The values of γ₀ in the paper's panels (b) and (c)."""
DELTA_GAMMA = 1.3
"""The fixed Δγ of panels (b) and (c), which the paper does not state."""
RELAXED = Setting("relaxed", "r-cbf-qp", 0.05, 0.0)
"""R. The paper does not state its γ₀; its path needs 0.1 or less."""
HIERARCHICAL = {g: Setting("hierarchical", "h-cbf-qp", g, DELTA_GAMMA) for g in GAMMAS}
"""H for each γ₀."""
TOO_LARGE = Setting("too large", "h-cbf-qp", 20.0, 2.5)
SETTINGS = (RELAXED, *HIERARCHICAL.values(), TOO_LARGE)

A1_V_MAX = FASTEST
"""The A1's cap on the speed [m/s]: a lower one leaves no time to catch up with the reference."""
A1_MARGIN = 0.025
"""The margin of the A1's rows [m], and of its speed limit [m/s]. The paper's rows have none, and
margins that depend on the tracking error would be a second cost beside that of the weights."""

GAMMA0_GRID = (0.05, *np.linspace(0.5, WINDOW["gamma0"], 10).tolist())
DELTA_GAMMA_GRID = np.linspace(0.0, WINDOW["delta_gamma"], 6).tolist()
"""The A1's samples, and the edges of the bands of Δγ in which the cheapest γ₀ is searched."""

LOWEST_INTERIOR, HIGHEST_INTERIOR = 1.0, WINDOW["gamma0"] - 0.25
"""The range of γ₀ in which a valley is interior. It leaves samples of the A1 on both sides, and
ends half a step of its grid below the window's edge."""


def fig5(runs: Runs, folder: Path, quick: bool) -> dict[str, Any]:
    """Draw figure 5 into a folder; `quick` samples fewer weights and leaves out the A1's cost.

    Returns ``claims`` {text: bool} and their data, in JSON types.
    """
    rom = simulate_rom()
    sampled = _simulate_sampled_weights(60 if quick else 200)
    rom_costs = TuningStudy(Problem(scenario=SCENE), Normal()).run(2000)
    plots.fig5_panels(rom, sampled, rom_costs).savefig(folder / "fig5-rom.png")
    result = {
        "claims": claims_of("ROM", rom) | map_claims_of("ROM", rom_costs),
        "rom": [_measures(setting, episode) for setting, episode in rom.items()],
        "rom_map": _map_summary(rom_costs),
        "least_h3_of_the_fan": float(sampled.min_h[:, H3].min()),
        "distance_of_r_and_h_with_equal_weights": _distance_with_equal_weights(),
    }

    scene = replace(scenarios.make(SCENE), v_max=A1_V_MAX)
    cases = {setting: setting.case(A1, scene, margin=A1_MARGIN) for setting in SETTINGS}
    jobs = {setting: Job(case) for setting, case in cases.items()}
    episodes = in_order(runs.over(Job.run, list(jobs.values()), "fig 5, A1"))
    a1 = dict(zip(jobs, episodes, strict=True))
    a1_costs = None if quick else _costs_on_a1(runs, scene, {"margin": A1_MARGIN})
    plots.fig5_panels(a1, None, a1_costs).savefig(folder / "fig5-a1.png")
    plots.fig5e_paths(SCENE, rom, a1).savefig(folder / "fig5e-paths.png")
    result["claims"] |= claims_of("A1", a1)
    if a1_costs is not None:
        result["claims"] |= map_claims_of("A1", a1_costs)
    r_and_h, times = [jobs[RELAXED], jobs[HIERARCHICAL[3.0]]], (2.0, 5.0, 8.0, 12.0)
    return result | {
        "a1": [_measures(setting, episode) for setting, episode in a1.items()],
        "a1_map": None if a1_costs is None else _map_summary(a1_costs),
        "frames": draw_frames(runs, r_and_h, times, folder / "fig5e-frames.png"),
    }


# Simulation


def simulate_rom() -> dict[Setting, Episode]:
    """Return an episode under each of `SETTINGS`."""
    cases = {setting: setting.case(ROM, SCENE, **ALPHAS) for setting in SETTINGS}
    return {setting: case.run(seed=0) for setting, case in cases.items()}


def _simulate_sampled_weights(count: int) -> Trajectories:
    """Return trajectories under H with the first `count` sampled weights in the paper's window."""
    normal, weights, number = Normal(), [], 0
    while len(weights) < count:
        draw = normal.draw(0, number)
        number += 1
        if draw.gamma0 <= WINDOW["gamma0"] and draw.delta_gamma <= WINDOW["delta_gamma"]:
            weights.append((draw.gamma0, draw.delta_gamma))
    return simulate(SCENE, "h-cbf-qp", *np.transpose(weights), options=ALPHAS)


def _distance_with_equal_weights() -> list[float]:
    """Return the greatest distance between R and H with the same weights, for each γ₀ [m]."""
    weights = GAMMAS, [DELTA_GAMMA] * len(GAMMAS)
    relaxed, hierarchical = (
        simulate(SCENE, program, *weights, options=ALPHAS) for program in ("r-cbf-qp", "h-cbf-qp")
    )
    distance = np.linalg.norm(relaxed.position - hierarchical.position, axis=2)
    return distance.max(axis=0).tolist()


def _costs_on_a1(runs: Runs, scene: Scenario, options: dict[str, Any]) -> Samples:
    """Return the A1's cost on a grid, because draws from N(µ, Σ) are too few at its edges."""
    problem = Problem(A1, scene, options=options)
    pairs = [(gamma0, delta_gamma) for gamma0 in GAMMA0_GRID for delta_gamma in DELTA_GAMMA_GRID]
    jobs = [Job(problem.case(*pair)) for pair in pairs]
    episodes = in_order(runs.over(Job.run, jobs, "fig 5d, A1"))
    costs = np.array([problem.cost_of(episode) for episode in episodes])
    gamma0, delta_gamma = np.array(pairs).T
    return Samples(gamma0, delta_gamma, costs)


# Measures and claims of the trajectories


def _measures(setting: Setting, episode: Episode) -> dict[str, Any]:
    error = episode.tracking_error
    return {
        "program": setting.program,
        "gamma0": setting.gamma0,
        "delta_gamma": setting.delta_gamma,
        "min_h3": float(episode.min_h[:, H3].min()),
        "min_h4": float(episode.min_h[:, H4].min()),
        "violation_of_h4": float(CONTROL_DT * sum(np.maximum(-episode.h[1:, H4], 0.0))),
        "tracking_rms": float(np.sqrt(sum(error[1:] ** 2) / len(error[1:]))),
        "greatest_error": float(error.max()),
        "final_error": float(error[-1]),
        "fell": episode.fell,
    }


def claims_of(model: str, episodes: dict[Setting, Episode]) -> dict[str, bool]:
    """Return whether the episodes under `SETTINGS` on a model show each claim of the paper."""
    by_setting = {setting: _measures(setting, episode) for setting, episode in episodes.items()}
    [relaxed] = of_role(by_setting, "relaxed").values()
    hierarchical = of_role(by_setting, "hierarchical").values()
    [too_large] = of_role(by_setting, "too large").values()
    violation = [measures["violation_of_h4"] for measures in hierarchical]
    min_h4 = [measures["min_h4"] for measures in hierarchical]
    rms = [measures["tracking_rms"] for measures in hierarchical]
    claims = {
        "no run falls": not any(measures["fell"] for measures in by_setting.values()),
        "h3 >= 0 throughout, for R, every H and too large weights": (
            min(measures["min_h3"] for measures in by_setting.values()) >= 0.0
        ),
        "h4 rises towards 0 with gamma0": (
            (np.diff(violation) < 0.0).all() and (np.diff(min_h4) >= 0.0).all()
        ),
        "the tracking error grows with gamma0": (np.diff(rms) > 0.0).all(),
        "R passes deeper through region 2 than every H": (
            relaxed["min_h4"] < min(min_h4) and relaxed["violation_of_h4"] > max(violation)
        ),
        "too large weights take the robot far from its reference": (
            too_large["final_error"]
            > 10.0 * max(measures["final_error"] for measures in hierarchical)
        ),
    }
    return {f"fig5, {model}: {text}": bool(holds) for text, holds in claims.items()}


# Measures and claims of the cost map: for every Δγ, the cheapest γ₀ is neither small nor large


def map_claims_of(model: str, samples: Samples) -> dict[str, bool]:
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


def _map_summary(samples: Samples) -> dict[str, Any]:
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
