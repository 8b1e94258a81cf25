"""Nominal policies under every program on held-out random scenes: the reduced order, and the A1.

The reduced-order cells run as one native batch, which walks as the single environments do; the A1
walks its scenes one after the other, with the policies as they were trained on the reduced order.
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from hcbf_gym import policies, wrappers
from hcbf_gym.envs.task import CONTROL_DT, MAX_EPISODE_STEPS
from hcbf_gym.evaluation.rollouts import SHOWN_OPTIONS, UNFILTERED, Case
from hcbf_gym.policies import PDTracker, Policy, learned
from hcbf_gym.scenarios.random_scenes import PRIORITIES

Array = NDArray[np.float64]

SCENARIO = "random"
PROGRAMS = (UNFILTERED, "r-cbf-qp", "h-cbf-qp", "eh-cbf-qp", "lex-cbf-qp")
_COLUMNS = (
    "policy",
    "program",
    "success",
    "return",
    "entered",
    "seconds_inside",
    "deepest_m",
    "intervention_rms",
    "fell",
)
_PRIORITY = np.array([1, 1, *PRIORITIES])  # the walls, then the regions
_OF = [rank == _PRIORITY for rank in (1, 2, 3)]


def run(quick: bool) -> dict[str, Any]:
    """Fill, print and return both tables.

    Args:
        quick: few scenes.
    """
    on_rom, on_a1 = (20, 1) if quick else (200, 50)
    names = ["pd", *learned.names()]
    return {
        "reduced order": table("reduced order", names, on_rom, rom_cell),
        "A1": table("A1", names, on_a1, a1_cell),
    }


def table(
    title: str,
    names: list[str],
    episodes: int,
    cell: Callable[[str, str, int], dict[str, Any]],
) -> list[dict[str, Any]]:
    """Fill and print the cells of policies × programs.

    Args:
        title: what is walking.
        names: of the policies.
        episodes: of each cell, with the seeds 0, 1, …
        cell: (policy, program, episodes) → figures.
    """
    rows = []
    for name in names:
        for program in PROGRAMS:
            rows.append({"policy": name, "program": program} | cell(name, program, episodes))
            print(" ".join(f"{key}={_text(value)}" for key, value in rows[-1].items()), flush=True)
    shown = Table(title=f"{title}: {episodes} held-out random scenes a cell, priorities 1 / 2 / 3")
    for heading in _COLUMNS:
        shown.add_column(heading.replace("_", " "))
    for row in rows:
        shown.add_row(*(_text(row[heading]) for heading in _COLUMNS))
    Console(width=140).print(shown)
    return rows


def rom_cell(name: str, program: str, episodes: int) -> dict[str, Any]:
    """Return the figures of a policy under a program on the reduced-order model."""
    env = gym.make_vec(
        "HCBF-Regions-v0", num_envs=episodes, scenario=SCENARIO, autoreset_mode="Disabled"
    )
    policy: Policy = PDTracker.for_env(env) if name == "pd" else policies.load(name, env)
    if program != UNFILTERED:
        env = wrappers.VectorSafetyFilter(env, program, **SHOWN_OPTIONS.get(program, {}))
    observation, info = env.reset(seed=0)
    m = len(_PRIORITY)
    least, inside = info["min_h"][:, :m].copy(), np.zeros((episodes, m))
    returns, steps, changed = np.zeros(episodes), np.zeros(episodes), np.zeros(episodes)
    reached, done = np.zeros(episodes, dtype=np.bool_), np.zeros(episodes, dtype=np.bool_)
    for _ in range(MAX_EPISODE_STEPS):
        observation, reward, terminated, truncated, info = env.step(
            np.asarray(policy(observation, info), dtype=np.float64)
        )
        running = ~done
        least[running] = np.minimum(least, info["min_h"][:, :m])[running]
        inside += CONTROL_DT * (info["h"][:, :m] < 0.0) * running[:, None]
        returns += running * reward
        steps += running
        if program != UNFILTERED:
            changed += running * info["safety_filter"]["intervention"] ** 2
        reached |= running & terminated
        done |= terminated | truncated
    env.close()
    rms = np.sqrt(changed / steps)
    return _figures(reached, returns, least, inside, rms, np.zeros(episodes))


def a1_cell(name: str, program: str, episodes: int) -> dict[str, Any]:
    """Return the figures of a policy under a program on the A1, and where it left strict rows."""
    case = Case("HCBF-A1Regions-v0", SCENARIO, name, program)
    m = len(_PRIORITY)
    summaries = [case.run(seed).summary() for seed in range(episodes)]
    least: Array = np.array([summary["min_h"] for summary in summaries])
    inside = np.array([summary["violation_seconds"] for summary in summaries])
    figures = _figures(
        np.array([summary["reached"] for summary in summaries]),
        np.array([summary["return"] for summary in summaries]),
        least[:, :m],
        inside[:, :m],
        np.array([summary["intervention_rms"] for summary in summaries]),
        np.array([summary["fell"] for summary in summaries]),
    )
    strict = least[:, :m][:, _PRIORITY == 1].min(axis=1)
    figures["over_speed_m_s"] = float(np.maximum(-least[:, m:], 0.0).max())
    figures["strict_cases"] = [
        [seed, round(float(strict[seed]), 4)] for seed in np.flatnonzero(strict < 0.0).tolist()
    ]
    return figures


def _figures(
    reached: NDArray[Any],
    returns: Array,
    least: Array,
    inside: Array,
    intervention: Array,
    fell: NDArray[Any],
) -> dict[str, Any]:
    """Return the figures of a cell from what each of its N episodes recorded.

    Args:
        reached: (N,) whether the goal was reached.
        returns: (N,).
        least: (N, m) least h [m].
        inside: (N, m) time with h < 0 [s].
        intervention: (N,) root mean square of ‖u − u*‖ [m/s²].
        fell: (N,) whether the robot fell.
    """
    depth = np.maximum(-np.column_stack([least[:, of].min(axis=1) for of in _OF]), 0.0)
    time_in = np.column_stack([inside[:, of].sum(axis=1) for of in _OF])
    return {
        "success": float(reached.mean()),
        "return": float(returns.mean()),
        "entered": (depth > 0.0).mean(axis=0).tolist(),
        "seconds_inside": time_in.mean(axis=0).tolist(),
        "deepest_m": depth.max(axis=0).tolist(),
        "intervention_rms": float(intervention.mean()),
        "fell": float(fell.mean()),
    }


def _text(value: Any) -> str:
    if isinstance(value, list) and value and isinstance(value[0], float):
        return " / ".join(f"{entry:.3g}" for entry in value)
    return f"{value:.3g}" if isinstance(value, float) else str(value)
