"""Regions faster than the robot: `random-crossing` under rows, guidance and gatekeeper.

Every scene is fresh, of the seeds 77000, 77001, … Speeds hold for an episode, or change
unannounced. An episode ends at the goal or after 20 s; the truth is looked at every 2 ms.
"""

from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.common import parallel, table
from benchmarks.suites.held_rows import POLICIES, Situation
from hcbf_gym.arrays import Array
from hcbf_gym.envs.task import CONTROL_DT, MAX_EPISODE_STEPS
from hcbf_gym.evaluation.statistics import BOUNDED, counted
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.wrappers import VectorSafetyFilter

FIRST_SEED, AT_ONCE = 77_000, 500
FILTERS: dict[str, dict[str, Any]] = {
    "lex-cbf-qp": {},
    "lex-cbf-qp, guidance": {"guidance": "geodesic"},
    "gatekeeper": {"strict": "gatekeeper"},
}
RESERVED = FILTERS | {
    "lex-cbf-qp, 5 cm reserved": {"margin": 0.05},
    "gatekeeper, 5 cm reserved": {"strict": "gatekeeper", "margin": 0.05},
}
"""And with a reserve against what regions will do unannounced."""
FULL = "full input"
DRIVERS = ("pd", FULL, "bang-bang")


def run(quick: bool) -> dict[str, Any]:
    """Return the figures of every policy under every filter, with known and hidden speeds."""
    cells = [
        {"intentions": intentions, "policy": policy, "filter": name}
        for intentions, filters in (("known", FILTERS), ("hidden", RESERVED))
        for policy in DRIVERS
        for name in filters
    ]
    parts = {"known": 1 if quick else 6, "hidden": 1 if quick else 2}
    jobs = [
        (*cell.values(), AT_ONCE * k, 60 if quick else AT_ONCE)
        for cell in cells
        for k in range(parts[cell["intentions"]])
    ]
    walked = iter(parallel(walk, jobs))
    found = [np.concatenate([next(walked) for _ in range(parts[c["intentions"]])]) for c in cells]
    return {"cells": [cell | amount(scenes) for cell, scenes in zip(cells, found, strict=True)]}


def walk(intentions: str, policy: str, name: str, first: int, count: int) -> Array:
    """Return (N, 5) of scenes: ranks 1, 2 entered, seconds to the goal, changed steps, steps."""
    bare = gym.make_vec(
        "HCBF-Regions-v0", num_envs=count, scenario="random-crossing", intentions=intentions,
        autoreset_mode="Disabled",
    )  # fmt: skip
    env: Any = VectorSafetyFilter(bare, **RESERVED[name])
    observation, info = env.reset(seed=FIRST_SEED + first)
    now = Situation(env, np.random.default_rng(first))
    corner = env.unwrapped.scenario.input_set.vertices().max()
    found, live = np.zeros((count, 5)), np.ones(count, dtype=np.bool_)
    entered, (seconds, changed, steps) = found[:, :2], found[:, 2:].T
    seconds[:] = np.inf
    for step in range(MAX_EPISODE_STEPS):
        now.look(observation, info)
        if policy == FULL:
            ahead = env.unwrapped.goal - now.x[:, :2]
            wanted = corner * ahead / np.abs(ahead).max(axis=1, keepdims=True)
        else:
            wanted = POLICIES[policy](now)
        observation, _, reached, _, info = env.step(wanted)
        differs = info["safety_filter"]["u_safe"] - np.clip(wanted, -corner, corner)
        entered[live] = np.maximum(entered, info["costs"] > 0.0)[live]
        changed += live & (np.abs(differs).max(axis=1) > 1e-4)
        steps += live
        seconds[live & reached] = CONTROL_DT * (step + 1)
        live &= ~reached
        if not live.any():
            break
    env.close()
    return found


def amount(found: Array) -> dict[str, Any]:
    """Return what the scenes of a cell amount to."""
    first, second, seconds, changed, steps = found.T
    arrived = np.isfinite(seconds)
    return {
        "scenes": len(found), "first": int(first.sum()), "second": int(second.sum()),
        "arrives": arrived.mean(), "seconds": seconds[arrived].mean() if arrived.any() else None,
        "changed": changed.sum() / steps.sum(),
    }  # fmt: skip


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the tables of docs/how_much.md: of known and of hidden speeds."""
    columns = {
        "policy": "{policy}", "filter": "{filter}",
        "enters rank 1": lambda row: counted(row["first"], row["scenes"]),
        "rank 2": lambda row: counted(row["second"], row["scenes"]),
        "arrives": "{arrives:.1%}",
        "after [s]": lambda row: "" if row["seconds"] is None else f"{row['seconds']:.1f}",
        "changed steps": "{changed:.1%}",
    }  # fmt: skip
    found = {}
    for intentions in ("known", "hidden"):
        rows = [row for row in figures["cells"] if row["intentions"] == intentions]
        title = f"random-crossing, {intentions} speeds, {rows[0]['scenes']} scenes a row; {BOUNDED}"
        found[intentions] = table(title, rows, columns)
    return found
