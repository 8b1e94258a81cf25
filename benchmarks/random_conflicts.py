"""Programs in random scenes that start in conflict: who is entered, how deep, at what price.

The reduced-order model under a held input, all scenes of a chunk at once; the barriers are looked
at every millisecond.
"""

from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import _core, programs
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, BarrierSet, Disc, HalfPlane, RowSettings
from hcbf_gym.barriers.planar_rows import planar_rows
from hcbf_gym.barriers.shape import PLACE
from hcbf_gym.errors import choose
from hcbf_gym.evaluation.measures import deadlocked
from hcbf_gym.models.input_sets import Box
from hcbf_gym.policies.pd import pd_law
from hcbf_gym.programs import FilterStatus

DT = 0.02
LOOKS = 20
STEPS = 900
LIMIT = 5.0
GOAL = np.array([8.0, 0.0])
TRAVEL_TIME = 12.0
REACHED = 0.25
LEVELS = 4

PROGRAMS: dict[str, tuple[str, dict[str, Any]] | None] = {
    "none": None,
    "cbf": ("cbf-qp", {}),
    "r 0.05": ("r-cbf-qp", {"gamma0": 0.05, "delta_gamma": 0.0}),
    "r 5": ("r-cbf-qp", {"gamma0": 5.0, "delta_gamma": 1.3}),
    "ih 3": ("ih-cbf-qp", {"gamma0": 3.0, "delta_gamma": 1.5}),
    "eh 3": ("eh-cbf-qp", {"gamma0": 3.0, "delta_gamma": 1.5}),
    "eh 100": ("eh-cbf-qp", {"gamma0": 100.0, "delta_gamma": 1.5}),
    "lex": ("lex-cbf-qp", {}),
}
"""What is compared: a name, and the program with its options."""

POLICIES = ("pd", "noisy", "adversarial")
"""PD on the straight line; the same with white noise of 3 m/s²; full thrust at the top region."""

ROWS = {  # Rows made for a held input, the usual ones, and those with 1 cm of margin
    "held": (RowSettings(period=DT, u_max=LIMIT * np.sqrt(2.0)), 0.0),
    "continuous": (RowSettings(), 0.0),
    "continuous + 1 cm": (RowSettings(), 0.01),
}


def random_scene(rng: np.random.Generator) -> tuple[Barrier, ...]:
    """Return two strict walls and four ranked discs, in conflict from the start.

    The robot wakes 0.3 to 0.5 m inside a disc whose nearest exit leads into one of higher priority,
    0.1 to 0.2 m ahead: both rows cannot be met. The other relaxed discs sweep across the path.
    """
    walls = (HalfPlane("left", 1, (0.0, -1.0), -2.5), HalfPlane("right", 1, (0.0, 1.0), -2.5))
    higher, lower = sorted(rng.choice(LEVELS, 2, replace=False) + 1)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    exit_ = np.array([np.cos(angle), np.sin(angle)])
    discs = []
    for priority in range(1, LEVELS + 1):
        radius, velocity = rng.uniform(0.6, 1.2), (0.0, 0.0)
        if priority == lower:
            center = (rng.uniform(0.3, 0.5) - radius) * exit_
        elif priority == higher:
            center = (rng.uniform(0.1, 0.2) + radius) * exit_
        else:
            center = np.array([rng.uniform(2.0, 8.0), rng.uniform(-2.5, 2.5)])
            heading = np.array([rng.uniform(1.0, 6.0), 0.0]) - center
            speed = 0.0 if priority == 1 else rng.uniform(0.0, 0.35)
            speed /= float(np.linalg.norm(heading))
            velocity = (speed * heading[0], speed * heading[1])
        name = f"region {priority}"
        discs.append(Disc(name, priority, (center[0], center[1]), radius, velocity))
    return (*walls, *discs)


class Scenes(NamedTuple):
    """Episodes that run together."""

    policy: str  # one of `POLICIES`
    program: str  # one of `PROGRAMS`
    rows: str  # one of `ROWS`
    seed: int  # decides scenes and noise; the scenes are the same for every policy and program
    start: int  # the first episode's number
    episodes: int  # how many


def run(chunk: Scenes) -> list[dict[str, Any]]:
    """Run the episodes, and return what each showed.

    `depth` [m], `seconds` inside and `excused` (a row could not be met at some time) have an entry
    for each priority; `clearance` is the least distance from strict regions and walls [m].
    """
    policy, program, rows, seed, start, count = chunk
    choose("policy", policy, dict.fromkeys(POLICIES))
    settings, margin = choose("rows", rows, ROWS)
    chosen = choose("program", program, PROGRAMS)
    scenes = [random_scene(np.random.default_rng([seed, start + i])) for i in range(count)]
    barriers = BarrierSet(scenes)
    input_set = Box.symmetric(LIMIT)
    batch = (
        None if chosen is None else programs.make_batch(chosen[0], input_set=input_set, **chosen[1])
    )

    noise = np.random.default_rng([seed, start, count])
    x, m = np.zeros((count, 4)), barriers.kind.shape[1]
    least, inside = barriers.values(x, np.zeros(count)), np.zeros((count, m))
    woke_in = barriers.priority[np.arange(count), least.argmin(axis=1)]
    unmet, effort = np.zeros((count, m), dtype=bool), np.zeros(count)
    stood = np.zeros(count)
    for step in range(STEPS):
        t = np.full(count, step * DT)
        u_nominal = _nominal(policy, x, t[0], barriers, noise)
        u = input_set.project(u_nominal)
        if batch is not None:
            result = batch(u_nominal, planar_rows(barriers, x, t, settings, margin))
            u = result.u
            unmet |= result.slack > 0.0
            assert (result.status != FilterStatus.BACKUP).all()
        effort += np.sum((u - u_nominal) ** 2, axis=1)
        stood += deadlocked(x[:, 2:], u_nominal, np.linalg.norm(x[:, :2] - GOAL, axis=1), REACHED)
        inside += advance(barriers, x, t, u, DT, LOOKS, least)

    near = np.linalg.norm(x[:, :2] - GOAL, axis=1) < REACHED
    of_rank = [barriers.priority == p + 1 for p in range(LEVELS)]
    depth = np.stack([np.where(r, -least, 0.0).max(axis=1) for r in of_rank], axis=1)
    seconds = np.stack([np.where(r, inside, 0.0).max(axis=1) for r in of_rank], axis=1)
    excused = np.stack([(r & unmet).any(axis=1) for r in of_rank], axis=1)
    return [
        {
            "woke_in": int(woke_in[i]),
            "depth": np.maximum(depth[i], 0.0).tolist(),
            "seconds": seconds[i].tolist(),
            "clearance": float(least[i, of_rank[0][i]].min()),
            "excused": excused[i].tolist(),
            "intervention": float(np.sqrt(effort[i] / STEPS)),
            "deadlock": float(stood[i] / STEPS),
            "reached": bool(near[i]),
        }
        for i in range(count)
    ]


def _nominal(
    policy: str, x: Array, t: float, barriers: BarrierSet, noise: np.random.Generator
) -> Array:
    """Return u* (N, 2)."""
    if policy == "adversarial":
        towards = barriers.parameters[:, 2, PLACE] - x[:, :2]
        return LIMIT * towards / np.linalg.norm(towards, axis=1, keepdims=True)
    share = min(t / TRAVEL_TIME, 1.0)
    velocity = GOAL / TRAVEL_TIME if share < 1.0 else np.zeros(2)
    u = pd_law(share * GOAL - x[:, :2], velocity - x[:, 2:])
    return u + noise.normal(0.0, 3.0, u.shape) if policy == "noisy" else u


def advance(
    barriers: BarrierSet, x: Array, t: Array, u: Array, dt: float, looks: int, least: Array
) -> Array:
    """Advance the double integrator x (N, 4) in place under a held u, looking at every barrier.

    Lowers `least` (N, m) to the smallest h seen; returns (N, m) the time with h < 0.
    """
    tau = np.arange(1, looks + 1)[:, None] * (dt / looks)
    path = np.empty((looks, *x.shape))
    path[:, :, :2] = x[:, :2] + tau[:, :, None] * (x[:, 2:] + 0.5 * tau[:, :, None] * u)
    path[:, :, 2:] = x[:, 2:] + tau[:, :, None] * u
    h = np.empty((looks, *least.shape))
    kinds = np.concatenate([barriers.kind] * looks)
    numbers = np.concatenate([barriers.parameters] * looks)
    states, times = path.reshape(-1, 4), np.ravel(t + tau)
    _core.barrier_values(kinds, numbers, None, states, times, h.reshape(-1, least.shape[1]))
    np.minimum(least, h.min(axis=0), out=least)
    x[:] = path[-1]
    return np.count_nonzero(h < 0.0, axis=0) * (dt / looks)


def summary(outcomes: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what a table has of the episodes of one policy, program and kind of rows.

    `entered` (share of the episodes that did not wake in it), `depth` (mean of those that were in
    it [m]) and `seconds` (mean over all [s]) have one entry for each priority;
    `entered_though_met` counts episodes that entered one whose rows could be met throughout.
    """
    depth = np.array([o["depth"] for o in outcomes])
    excused = np.array([o["excused"] for o in outcomes])
    elsewhere = np.array([o["woke_in"] for o in outcomes])[:, None] != np.arange(1, LEVELS + 1)
    entered, inside = (depth > 0.0) & elsewhere, depth > 0.0
    clearance = np.array([o["clearance"] for o in outcomes])
    return {
        "episodes": len(outcomes),
        "entered": (entered.sum(axis=0) / np.maximum(elsewhere.sum(axis=0), 1)).tolist(),
        "depth": (depth.sum(axis=0) / np.maximum(inside.sum(axis=0), 1)).tolist(),
        "seconds": np.mean([o["seconds"] for o in outcomes], axis=0).tolist(),
        "entered_though_met": (entered & ~excused).sum(axis=0).tolist(),
        "conflict": float(excused.any(axis=1).mean()),
        "least_clearance": float(clearance.min()),
        "median_clearance": float(np.median(clearance)),
        "intervention": float(np.mean([o["intervention"] for o in outcomes])),
        "deadlock": float(np.mean([o["deadlock"] for o in outcomes])),
        "reached": float(np.mean([o["reached"] for o in outcomes])),
    }
