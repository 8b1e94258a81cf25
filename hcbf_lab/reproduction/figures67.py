"""Figures 6 and 7: the experiment with boxes, on the A1 in full physics."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym import scenarios
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_gym.evaluation.rollouts import Case, Episode, Job
from hcbf_lab.reproduction import plots
from hcbf_lab.reproduction.film import draw_frames

SCENE, STRAIGHT = "paper-experiment", "paper-experiment-straight"
R_WEIGHTS = ("r-cbf-qp", 0.05, 0.0)
"""(program, γ₀, Δγ) of R. The paper does not state γ₀; with this one R passes close to region 1."""
H_WEIGHTS = ("h-cbf-qp", 0.5, 1.3)
"""(program, γ₀, Δγ) of H: the paper's Δγ, and a γ₀ with which the A1 passes the corridor."""
PAPER_WEIGHTS = ("h-cbf-qp", 5.0, 1.3)
"""(program, γ₀, Δγ) of H in the paper, with which the A1 stalls in the corridor."""

SEEDS = 20
RANDOMIZATION = {
    "floor_friction": (0.6, 1.0),
    "start_distance": (0.0, 0.05),
    "start_yaw": (0.0, 0.2),
}
"""Friction of the floor, start [m] and heading [rad], drawn for each seed."""
DISTURBANCES = {"kind": "random", "interval": 4.0, "impulse": (1.0, 3.0)}
"""A push of 1 to 3 N·s in a random direction, one every 4 s on average."""

_H3, _H4 = 2, 3  # columns of h: region 1 and region 2
_BOX = 0  # index of region 2's box


def fig6(runs: Runs, folder: Path, quick: bool) -> dict[str, Any]:
    """Draw figure 6 into a folder, and count contacts over disturbed episodes, fewer if `quick`.

    Returns ``claims`` {text: bool} and their data, in JSON types.
    """
    jobs = _jobs()
    results = in_order(runs.over(Job.run, list(jobs.values()), "fig 6"))
    episodes = dict(zip(jobs, results, strict=True))
    relaxed, hierarchical = episodes["R"], episodes["H"]
    series = {"R-CBF-QP": relaxed, "H-CBF-QP": hierarchical}
    plots.fig6_series(series).savefig(folder / "fig6-barriers.png")
    plots.paths(
        STRAIGHT,
        {"R": (episodes["R, straight"], "-"), "H": (episodes["H, straight"], "-")},
        "straight reference",
    ).savefig(folder / "fig6-straight.png")
    plots.paths(
        SCENE,
        {"H, (0.5, 1.3)": (hierarchical, "-"), "H, (5, 1.3)": (episodes["H, (5, 1.3)"], ":")},
        "the paper's own pair",
    ).savefig(folder / "fig6-own-pair.png")
    result = {
        "claims": _claims(episodes),
        "episodes": {name: _summary(episode) for name, episode in episodes.items()},
        "seeds": _over_seeds(runs, range(4 if quick else SEEDS)),
    }
    r_and_h, times = [jobs["R"], jobs["H"]], (4.0, 6.0, 8.0, 16.0)
    return result | {"frames": draw_frames(runs, r_and_h, times, folder / "fig6-frames.png")}


def fig7(runs: Runs, folder: Path, quick: bool) -> dict[str, Any]:
    """Draw figure 7 from the episodes of figure 6; see `fig6` for the arguments."""
    jobs = _jobs()
    relaxed, hierarchical = in_order(runs.over(Job.run, [jobs["R"], jobs["H"]], "fig 7"))
    plots.fig7(SCENE, relaxed, hierarchical).savefig(folder / "fig7.png")
    beside = {"R": _beside_the_box(relaxed), "H": _beside_the_box(hierarchical)}
    return {
        "claims": {
            "fig7: beside the box, H keeps farther from it than R": beside["H"] > beside["R"]
        },
        "x_beside_the_box": beside,
    }


def _jobs() -> dict[str, Job]:
    """Return the undisturbed episodes of both figures, by the labels of the pictures."""
    return {
        "R": _job(SCENE, R_WEIGHTS),
        "H": _job(SCENE, H_WEIGHTS),
        "H, (5, 1.3)": _job(SCENE, PAPER_WEIGHTS),
        "R, straight": _job(STRAIGHT, R_WEIGHTS),
        "H, straight": _job(STRAIGHT, H_WEIGHTS),
    }


def _job(
    scene: str,
    weights: tuple[str, float, float],
    seed: int = 0,
    env_options: dict[str, Any] | None = None,
) -> Job:
    """Return an episode of PD on the A1 under (program, γ₀, Δγ)."""
    program, gamma0, delta_gamma = weights
    options = {"gamma0": gamma0, "delta_gamma": delta_gamma}
    return Job(Case("HCBF-A1Regions-v0", scene, "pd", program, options, env_options), seed)


def _disturbed(weights: tuple[str, float, float], seed: int) -> Job:
    """Return an episode whose seed decides the start, the floor's friction and the pushes."""
    env_options = {"randomization": RANDOMIZATION, "disturbances": DISTURBANCES}
    return _job(SCENE, weights, seed, env_options)


def _over_seeds(runs: Runs, seeds: Sequence[int]) -> dict[str, dict[str, Any]]:
    """Return for R and H in how many episodes the robot touched the box, arrived, and fell."""
    jobs = [_disturbed(weights, seed) for weights in (R_WEIGHTS, H_WEIGHTS) for seed in seeds]
    episodes = in_order(runs.over(Job.run, jobs, "fig 6, seeds"))
    groups = {"R": episodes[: len(seeds)], "H": episodes[len(seeds) :]}
    return {
        name: {
            "episodes": len(group),
            "touched_the_box": sum(_touches(episode) > 0 for episode in group),
            "reached": sum(bool(episode.reached) for episode in group),
            "fell": sum(episode.fell for episode in group),
            "least_h3": min(float(episode.min_h[:, _H3].min()) for episode in group),
            "least_h4": [float(episode.min_h[:, _H4].min()) for episode in group],
            "mean_violation_of_h4": float(np.mean([_violation(episode) for episode in group])),
        }
        for name, group in groups.items()
    }


def _touches(episode: Episode) -> int:
    """Return the number of control steps in which the robot touched region 2's box."""
    return int((episode.obstacle_force[:, _BOX] > 0.0).sum())


def _violation(episode: Episode) -> float:
    """Return the violation of region 2, ∫ max(0, −h₄) dt [m·s]."""
    return float(CONTROL_DT * np.maximum(-episode.h[1:, _H4], 0.0).sum())


def _summary(episode: Episode) -> dict[str, Any]:
    return {
        "steps_touching_the_box": _touches(episode),
        "greatest_force_on_it": float(episode.obstacle_force[:, _BOX].max()),
        "reached": episode.reached,
        "fell": episode.fell,
        "final_error": float(episode.tracking_error[-1]),
        "min_h3": float(episode.min_h[:, _H3].min()),
        "min_h4": float(episode.min_h[:, _H4].min()),
        "violation_of_h4": _violation(episode),
    }


def _beside_the_box(episode: Episode) -> float:
    """Return the least p_x beyond the box's centre while the robot is beside the box [m]."""
    box = scenarios.make(SCENE).obstacles[_BOX]
    x, y = episode.position.T
    beside = np.abs(y - box.center[1]) <= box.size[1] / 2
    return float(x[beside].min() - box.center[0])


def _claims(episodes: dict[str, Episode]) -> dict[str, bool]:
    """Return whether the episodes show each claim of the paper."""
    relaxed, hierarchical = episodes["R"], episodes["H"]
    claims = {
        "R touches region 2's box": _touches(relaxed) > 0,
        "R still reaches the goal": relaxed.reached,
        "H does not touch it": _touches(hierarchical) == 0,
        "H reaches the goal": hierarchical.reached,
        "H violates h4 less than R, at its worst": (
            hierarchical.min_h[:, _H4].min() > relaxed.min_h[:, _H4].min()
        ),
        "H violates h4 less than R, over time": _violation(hierarchical) < _violation(relaxed),
        "h3 >= 0 throughout, for R and H": (
            relaxed.min_h[:, _H3].min() >= 0.0 and hierarchical.min_h[:, _H3].min() >= 0.0
        ),
    }
    return {f"fig6: {text}": bool(holds) for text, holds in claims.items()}
