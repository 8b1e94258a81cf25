"""Figures 6 and 7: the paper's experiment, in which the A1 walks between boxes in full physics.

Heavy boxes mark region 1 (barrier h₃, strict), and a light box is at the center of region 2
(barrier h₄, relaxed). R-CBF-QP (R) touches the light box, and H-CBF-QP (H) avoids it.
Figure 6: pictures, and h₃, h₄ and the contacts over time. Figure 7: the paths and positions.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym import scenarios
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_gym.evaluation.rollouts import Episode, Job
from hcbf_lab.reproduction import plots
from hcbf_lab.reproduction.film import draw_frames
from hcbf_lab.reproduction.setting import A1, H3, H4, LIGHT_BOX, Setting

SCENE, STRAIGHT = "paper-experiment", "paper-experiment-straight"
RELAXED = Setting("relaxed", "r-cbf-qp", 0.05, 0.0)
"""R. The paper does not state its γ₀; with this one R passes close to region 1."""
HIERARCHICAL = Setting("hierarchical", "h-cbf-qp", 0.5, 1.3)
"""H with the paper's Δγ, and a γ₀ with which the A1 passes the corridor."""
TOO_LARGE = Setting("too large", "h-cbf-qp", 5.0, 1.3)
"""H with the paper's weights, with which the A1 stalls in the corridor."""

SEEDS = 20
RANDOMIZATION = {
    "floor_friction": (0.6, 1.0),
    "start_distance": (0.0, 0.05),
    "start_yaw": (0.0, 0.2),
}
"""Friction of the floor, start [m] and heading [rad], drawn for each seed."""
DISTURBANCES = {"kind": "random", "interval": 4.0, "impulse": (1.0, 3.0)}
"""A push of 1 to 3 N·s in a random direction, one every 4 s on average."""


def fig6(runs: Runs, folder: Path, quick: bool) -> dict[str, Any]:
    """Draw figure 6 into a folder, and count contacts over disturbed episodes, fewer if `quick`.

    Returns ``claims`` {text: bool} and their data, in JSON types.
    """
    jobs = undisturbed_jobs()
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
    seeds = range(4 if quick else SEEDS)
    result = {
        "claims": claims_of(episodes),
        "episodes": {name: _summary(episode) for name, episode in episodes.items()},
        "seeds": {
            "R": _summary_over_seeds(_disturbed_episodes(runs, RELAXED, seeds)),
            "H": _summary_over_seeds(_disturbed_episodes(runs, HIERARCHICAL, seeds)),
        },
    }
    r_and_h, times = [jobs["R"], jobs["H"]], (4.0, 6.0, 8.0, 16.0)
    return result | {"frames": draw_frames(runs, r_and_h, times, folder / "fig6-frames.png")}


def fig7(runs: Runs, folder: Path, quick: bool) -> dict[str, Any]:
    """Draw figure 7 from the episodes of figure 6; see `fig6` for the arguments."""
    jobs = undisturbed_jobs()
    relaxed, hierarchical = in_order(runs.over(Job.run, [jobs["R"], jobs["H"]], "fig 7"))
    plots.fig7(SCENE, relaxed, hierarchical).savefig(folder / "fig7.png")
    beside = {"R": _beside_the_box(relaxed), "H": _beside_the_box(hierarchical)}
    return {
        "claims": {
            "fig7: beside the box, H keeps farther from it than R": beside["H"] > beside["R"]
        },
        "x_beside_the_box": beside,
    }


# Simulation


def undisturbed_jobs() -> dict[str, Job]:
    """Return the undisturbed episodes of both figures, by the labels of the pictures."""
    return {
        "R": Job(RELAXED.case(A1, SCENE)),
        "H": Job(HIERARCHICAL.case(A1, SCENE)),
        "H, (5, 1.3)": Job(TOO_LARGE.case(A1, SCENE)),
        "R, straight": Job(RELAXED.case(A1, STRAIGHT)),
        "H, straight": Job(HIERARCHICAL.case(A1, STRAIGHT)),
    }


def _disturbed_episodes(runs: Runs, setting: Setting, seeds: Sequence[int]) -> list[Episode]:
    """Return episodes whose seed decides the start, the floor's friction and the pushes."""
    env_options = {"randomization": RANDOMIZATION, "disturbances": DISTURBANCES}
    case = setting.case(A1, SCENE, env_options)
    return in_order(runs.over(Job.run, [Job(case, seed) for seed in seeds], "fig 6, seeds"))


# Measures and claims


def _summary_over_seeds(episodes: Sequence[Episode]) -> dict[str, Any]:
    """Return in how many episodes the robot touched the box, arrived and fell, and its barriers."""
    return {
        "episodes": len(episodes),
        "touched_the_box": sum(_contact_steps(episode) > 0 for episode in episodes),
        "reached": sum(bool(episode.reached) for episode in episodes),
        "fell": sum(episode.fell for episode in episodes),
        "least_h3": min(float(episode.min_h[:, H3].min()) for episode in episodes),
        "least_h4": [float(episode.min_h[:, H4].min()) for episode in episodes],
        "mean_violation_of_h4": float(np.mean([_violation(episode) for episode in episodes])),
    }


def _contact_steps(episode: Episode) -> int:
    """Return the number of control steps in which the robot touched region 2's box."""
    return int((episode.obstacle_force[:, LIGHT_BOX] > 0.0).sum())


def _violation(episode: Episode) -> float:
    """Return the violation of region 2, ∫ max(0, −h₄) dt [m·s]."""
    return float(CONTROL_DT * np.maximum(-episode.h[1:, H4], 0.0).sum())


def _summary(episode: Episode) -> dict[str, Any]:
    return {
        "steps_touching_the_box": _contact_steps(episode),
        "greatest_force_on_it": float(episode.obstacle_force[:, LIGHT_BOX].max()),
        "reached": episode.reached,
        "fell": episode.fell,
        "final_error": float(episode.tracking_error[-1]),
        "min_h3": float(episode.min_h[:, H3].min()),
        "min_h4": float(episode.min_h[:, H4].min()),
        "violation_of_h4": _violation(episode),
    }


def _beside_the_box(episode: Episode) -> float:
    """Return the least p_x beyond the box's centre while the robot is beside the box [m]."""
    box = scenarios.make(SCENE).obstacles[LIGHT_BOX]
    x, y = episode.position.T
    beside = np.abs(y - box.center[1]) <= box.size[1] / 2
    return float(x[beside].min() - box.center[0])


def claims_of(episodes: dict[str, Episode]) -> dict[str, bool]:
    """Return whether the episodes show each claim of the paper."""
    relaxed, hierarchical = episodes["R"], episodes["H"]
    claims = {
        "R touches region 2's box": _contact_steps(relaxed) > 0,
        "R still reaches the goal": relaxed.reached,
        "H does not touch it": _contact_steps(hierarchical) == 0,
        "H reaches the goal": hierarchical.reached,
        "H violates h4 less than R, at its worst": (
            hierarchical.min_h[:, H4].min() > relaxed.min_h[:, H4].min()
        ),
        "H violates h4 less than R, over time": _violation(hierarchical) < _violation(relaxed),
        "h3 >= 0 throughout, for R and H": (
            relaxed.min_h[:, H3].min() >= 0.0 and hierarchical.min_h[:, H3].min() >= 0.0
        ),
    }
    return {f"fig6: {text}": bool(holds) for text, holds in claims.items()}
