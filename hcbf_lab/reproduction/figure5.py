"""Figure 5: tracking error and safety over the weights, on the reduced-order model and the A1."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym import scenarios
from hcbf_gym.arrays import Array
from hcbf_gym.envs.a1_plant import FASTEST
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_gym.evaluation.rollouts import Case, Episode, Job
from hcbf_gym.scenarios import Scenario
from hcbf_lab.reproduction import plots
from hcbf_lab.reproduction.film import draw_frames
from hcbf_lab.tuning import WINDOW, Normal, Problem, Samples, Trajectories, TuningStudy, simulate
from hcbf_lab.tuning.cost import relaxation
from hcbf_lab.tuning.cost_map import inside
from hcbf_lab.tuning.problem import ALPHAS

SCENE = "paper-simulation"
R_WEIGHT = 0.05  # γ₀ of R-CBF-QP, which the paper does not state; its path needs 0.1 or less
DELTA_GAMMA = 1.3  # the fixed Δγ of panels (b) and (c), which the paper does not state
GAMMAS = (1.0, 2.0, 3.0, 4.0, 5.0)
TOO_LARGE = (20.0, 2.5)  # (γ₀, Δγ)
A1_V_MAX = FASTEST
"""The A1's cap on the speed [m/s]: a lower one leaves no time to catch up with the reference."""
A1_MARGIN = 0.025
"""The margin of the A1's rows [m], and of its speed limit [m/s]. The paper's rows have none, and
margins that depend on the tracking error would be a second cost beside that of the weights."""

_H3, _H4 = 2, 3  # columns of h: region 1 and region 2
_GRID = ((0.05, *np.linspace(0.5, 5.0, 10).tolist()), np.linspace(0.0, 2.5, 6).tolist())
_BANDS = np.linspace(0.0, WINDOW["delta_gamma"], 6)  # edges of the bands of Δγ
_INNER = (1.0, 4.75)
"""The range of γ₀ in which a valley is interior: inside the window, with samples on both sides."""


def fig5(runs: Runs, folder: Path, quick: bool) -> dict[str, Any]:
    """Draw figure 5 into a folder, with a smaller fan and without the A1's cost if `quick`.

    Returns ``claims`` {text: bool} and their data, in JSON types.
    """
    fan = _fan(60 if quick else 200)
    rom = _rom()
    samples = TuningStudy(Problem(scenario=SCENE), Normal()).run(2000)
    plots.fig5_panels(rom, GAMMAS, fan, samples).savefig(folder / "fig5-rom.png")
    result = {
        "claims": _claims("ROM", rom) | _map_claims("ROM", samples),
        "rom": _summary(rom),
        "rom_map": _map_summary(samples),
        "least_h3_of_the_fan": float(fan.min_h[:, _H3].min()),
        "distance_of_r_and_h_with_equal_weights": _distance_with_equal_weights(),
    }
    a1_result = _on_a1(runs, folder, quick, rom)
    return result | a1_result | {"claims": result["claims"] | a1_result["claims"]}


def _on_a1(runs: Runs, folder: Path, quick: bool, rom: Trajectories) -> dict[str, Any]:
    """Draw the A1's panels, and its paths beside those of `rom`; return the same as `fig5`."""
    scene = _a1_scene()
    jobs = [Job(_a1_case(scene, *settings)) for settings in _settings()]
    a1 = _of_episodes(in_order(runs.over(Job.run, jobs, "fig 5, A1")))
    samples = None if quick else _a1_samples(runs)
    plots.fig5_panels(a1, GAMMAS, None, samples).savefig(folder / "fig5-a1.png")
    plots.fig5e_paths(SCENE, rom, a1, GAMMAS).savefig(folder / "fig5e-paths.png")
    result = {
        "claims": _claims("A1", a1) | ({} if samples is None else _map_claims("A1", samples)),
        "a1": _summary(a1),
        "a1_map": None if samples is None else _map_summary(samples),
    }
    r_and_h, times = [jobs[0], jobs[3]], (2.0, 5.0, 8.0, 12.0)  # H with γ₀ = 3
    frames = draw_frames(runs, r_and_h, times, folder / "fig5e-frames.png")
    return result | {"frames": frames}


def _settings() -> list[tuple[str, float, float]]:
    """Return (program, γ₀, Δγ) of R, of H for each γ₀, and of H with too large weights."""
    return [
        ("r-cbf-qp", R_WEIGHT, 0.0),
        *(("h-cbf-qp", gamma0, DELTA_GAMMA) for gamma0 in GAMMAS),
        ("h-cbf-qp", *TOO_LARGE),
    ]


def _a1_scene() -> Scenario:
    return replace(scenarios.make(SCENE), v_max=A1_V_MAX)


def _a1_case(scene: Scenario, program: str, gamma0: float, delta_gamma: float) -> Case:
    options = {"gamma0": gamma0, "delta_gamma": delta_gamma, "margin": A1_MARGIN}
    return Case("HCBF-A1Regions-v0", scene, "pd", program, options)


def _draws(count: int) -> Array:
    """Return the first draws (count, 2) of the paper's sampling that are inside its window."""
    normal, draws, number = Normal(), [], 0
    while len(draws) < count:
        draw = normal.draw(0, number)
        number += 1
        if draw.gamma0 <= WINDOW["gamma0"] and draw.delta_gamma <= WINDOW["delta_gamma"]:
            draws.append((draw.gamma0, draw.delta_gamma))
    return np.array(draws)


def _fan(count: int) -> Trajectories:
    """Return trajectories of H on the reduced-order model, under sampled weights."""
    return simulate(SCENE, "h-cbf-qp", *_draws(count).T, options=ALPHAS)


def _rom() -> Trajectories:
    """Return the trajectories of `_settings` on the reduced-order model."""
    settings = _settings()
    relaxed = simulate(SCENE, "r-cbf-qp", [settings[0][1]], [settings[0][2]], options=ALPHAS)
    weights = np.array([(gamma0, delta_gamma) for _, gamma0, delta_gamma in settings[1:]])
    hierarchical = simulate(SCENE, "h-cbf-qp", *weights.T, options=ALPHAS)
    return _side_by_side(relaxed, hierarchical)


def _distance_with_equal_weights() -> list[float]:
    """Return the greatest distance between R and H with the same weights, for each γ₀ [m]."""
    weights = GAMMAS, [DELTA_GAMMA] * len(GAMMAS)
    relaxed, hierarchical = (
        simulate(SCENE, program, *weights, options=ALPHAS) for program in ("r-cbf-qp", "h-cbf-qp")
    )
    apart = np.linalg.norm(relaxed.position - hierarchical.position, axis=2)
    return apart.max(axis=0).tolist()


def _a1_samples(runs: Runs) -> Samples:
    """Return the A1's cost on a grid, because draws from N(µ, Σ) are too few at its edges."""
    problem = Problem("HCBF-A1Regions-v0", _a1_scene(), options={"margin": A1_MARGIN})
    pairs = [(gamma0, delta_gamma) for gamma0 in _GRID[0] for delta_gamma in _GRID[1]]
    jobs = [Job(problem.case(*pair)) for pair in pairs]
    episodes = in_order(runs.over(Job.run, jobs, "fig 5d, A1"))
    costs = np.array([problem.cost_of(episode) for episode in episodes])
    gamma0, delta_gamma = np.array(pairs).T
    return Samples(gamma0, delta_gamma, costs)


def _side_by_side(*batches: Trajectories) -> Trajectories:
    """Return one batch of the trajectories of several batches with the same times."""
    joined = {}
    for name in Trajectories._fields[1:]:
        axis_of_trajectories = 0 if name in ("min_h", "fell") else 1
        fields = [getattr(batch, name) for batch in batches]
        joined[name] = np.concatenate(fields, axis=axis_of_trajectories)
    return Trajectories(batches[0].time, **joined)


def _of_episodes(episodes: list[Episode]) -> Trajectories:
    """Return episodes as one batch, which ends with the shortest of them."""
    steps = min(len(episode.time) for episode in episodes)
    return _side_by_side(*(
        Trajectories(
            time=episode.time[:steps], position=episode.position[:steps, None],
            h=episode.h[:steps, None], min_h=episode.min_h.min(axis=0)[None],
            tracking_error=episode.tracking_error[:steps, None],
            relaxation=relaxation(episode.delta, episode.priority)[: steps - 1, None],
            fell=np.array([episode.fell]),
        )
        for episode in episodes
    ))  # fmt: skip


def _summary(run: Trajectories) -> list[dict[str, Any]]:
    """Return the measures of each trajectory, in the order of `_settings`."""
    violation = CONTROL_DT * np.maximum(-run.h[1:, :, _H4], 0.0).sum(axis=0)
    rms = np.sqrt(np.mean(run.tracking_error[1:] ** 2, axis=0))
    return [
        {
            "program": program,
            "gamma0": gamma0,
            "delta_gamma": delta_gamma,
            "min_h3": float(run.min_h[k, _H3]),
            "min_h4": float(run.min_h[k, _H4]),
            "violation_of_h4": float(violation[k]),
            "tracking_rms": float(rms[k]),
            "greatest_error": float(run.tracking_error[:, k].max()),
            "final_error": float(run.tracking_error[-1, k]),
            "fell": bool(run.fell[k]),
        }
        for k, (program, gamma0, delta_gamma) in enumerate(_settings())
    ]


def _claims(model: str, run: Trajectories) -> dict[str, bool]:
    """Return whether the trajectories of `_settings` on a model show each claim of the paper."""
    measures = _summary(run)
    relaxed, hierarchical, too_large = measures[0], measures[1:-1], measures[-1]
    violation = [measure["violation_of_h4"] for measure in hierarchical]
    min_h4 = [measure["min_h4"] for measure in hierarchical]
    rms = [measure["tracking_rms"] for measure in hierarchical]
    claims = {
        "no run falls": not run.fell.any(),
        "h3 >= 0 throughout, for R, every H and too large weights": (
            min(measure["min_h3"] for measure in measures) >= 0.0
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
            > 10.0 * max(measure["final_error"] for measure in hierarchical)
        ),
    }
    return {f"fig5, {model}: {text}": bool(holds) for text, holds in claims.items()}


def _valley(samples: Samples) -> list[float | None]:
    """Return the cheapest γ₀ in each of `_BANDS`; None if a side of `_INNER` has no sample."""
    shown = inside(samples)
    cheapest: list[float | None] = []
    for low, high in pairwise(_BANDS):
        band = (low <= shown.delta_gamma) & (shown.delta_gamma <= high)
        gamma0 = shown.gamma0[band]
        is_sampled = gamma0.size and gamma0.min() < _INNER[0] and gamma0.max() > _INNER[1]
        cheapest.append(float(gamma0[np.argmin(shown.cost[band])]) if is_sampled else None)
    return cheapest


def _map_claims(model: str, samples: Samples) -> dict[str, bool]:
    """Return whether the map of the cost on a model shows each claim of the paper."""
    shown = inside(samples)
    valley = _valley(samples)
    is_interior = [gamma0 is not None and _INNER[0] < gamma0 < _INNER[1] for gamma0 in valley]
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
    shown = inside(samples)
    best = shown.best
    return {
        "samples": len(samples.cost),
        "inside_the_window": len(shown.cost),
        "best_gamma0": float(shown.gamma0[best]),
        "best_delta_gamma": float(shown.delta_gamma[best]),
        "least_cost": float(shown.cost[best]),
        "greatest_offset": float(shown.offset.max()),
        "bands_of_delta_gamma": _BANDS.tolist(),
        "cheapest_gamma0_in_band": _valley(samples),
    }
