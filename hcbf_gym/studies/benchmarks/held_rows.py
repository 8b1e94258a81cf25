"""Held rows in random scenes: no policy may get past a strict barrier, and PD must still arrive.

The reduced-order model at 50 Hz without margins, under lex-cbf-qp, looked at every millisecond.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from hcbf_gym import programs, scenarios
from hcbf_gym.barriers import BarrierSet, RowSettings, SpeedLimit
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.models.input_sets import Box
from hcbf_gym.programs import FilterStatus
from hcbf_gym.scenarios import Scenario
from hcbf_gym.studies.monte_carlo.episodes import advance

Array = NDArray[np.float64]
Draw = np.random.Generator

DT, LOOKS, STEPS = 0.02, 20, 1000
U = Box.symmetric(5.0)
FIRST_SEED = 50_000
NOISE = 3.0
"""Standard deviation of what is added to PD in the policy "noise" [m/s²]."""

SETTINGS = {
    "held": (RowSettings(period=DT, u_max=U.radius), 0.0),
    "usual": (RowSettings(), 0.0),
    "usual + 1 cm": (RowSettings(), 0.01),
}
"""Rows by name, with the margin of strict ones [m]."""


class Situation:
    """What a policy sees of N scenes.

    Args:
        scenes: N scenarios, each with its goal.
        rng: for policies that draw.

    Attributes:
        barriers: of the scenes, the speed limit last.
        goal: (N, 2) [m].
        x: (N, 4) [m] and [m/s].
        strict: (N, m) strict barriers on the position.
    """

    def __init__(self, scenes: list[Scenario], rng: Draw):
        limits = [SpeedLimit("speed limit", 1, scene.v_max or np.inf) for scene in scenes]
        pairs = zip(scenes, limits, strict=True)
        self.barriers = BarrierSet([(*scene.barriers, limit) for scene, limit in pairs])
        self.goal = np.array([scene.goal for scene in scenes])
        self.x = np.array([[*scene.start, 0.0, 0.0] for scene in scenes])
        self.strict = self.barriers.keeps_margin == 1.0
        self.rng = rng
        self.sign, self.corner = np.ones(len(scenes)), np.zeros((len(scenes), 2))

    def nearest_normals(self, t: Array) -> tuple[Array, Array]:
        """Return (N, 2) ∇h of the nearest strict barrier, and of the second nearest."""
        h, sensed = self.barriers.sense(self.x, t)
        order = np.argsort(np.where(self.strict, h, np.inf), axis=1)
        every = np.arange(len(h))
        return sensed[every, order[:, 0], 1:3], sensed[every, order[:, 1], 1:3]


def _pd(now: Situation, t: Array) -> Array:
    return 2.0 * (now.goal - now.x[:, :2]) - 3.0 * now.x[:, 2:]


def _noise(now: Situation, t: Array) -> Array:
    return _pd(now, t) + now.rng.normal(0.0, NOISE, now.goal.shape)


def _at_the_nearest(now: Situation, t: Array) -> Array:
    return -U.radius * now.nearest_normals(t)[0]


def _into_the_corner(now: Situation, t: Array) -> Array:
    first, second = now.nearest_normals(t)
    return -U.radius * (first + 0.9 * second)


def _along_the_edge(now: Situation, t: Array) -> Array:
    normal = now.nearest_normals(t)[0]
    now.sign[now.rng.random(len(now.sign)) < DT / 0.8] *= -1.0
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    return U.radius * (now.sign[:, None] * tangent - normal)


def _bang_bang(now: Situation, t: Array) -> Array:
    changes = now.rng.random(len(now.corner)) < DT / 0.3
    now.corner[changes] = 5.0 * now.rng.choice([-1.0, 1.0], (int(changes.sum()), 2))
    return now.corner


POLICIES: dict[str, Callable[[Situation, Array], Array]] = {
    "pd": _pd,
    "noise": _noise,
    "at the nearest region": _at_the_nearest,
    "into the corner": _into_the_corner,
    "along the edge, reversing": _along_the_edge,
    "bang-bang": _bang_bang,
}
"""Friendly, disturbed, and hostile ones, which push with all that U allows."""


def run(quick: bool) -> dict[str, Any]:
    """Run every policy under held rows, and PD under the usual ones; print and return figures."""
    episodes = 50 if quick else 1000
    cases = [
        (family, policy, rows)
        for family in ("random", "random-moving")
        for policy in POLICIES
        for rows in (SETTINGS if policy == "pd" else ("held",))
    ]
    results = [episode(*case, episodes) for case in track(cases, "policies")]
    figures = {"held_rows": results}
    Console(width=160).print(tables(figures)["held-rows"].rich())
    return figures


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the one table: a line for each family of scenes, policy and kind of rows."""
    results = figures["held_rows"]
    title = f"lex-cbf-qp, {results[0]['episodes']} scenes a row, 20 s each, looked at at 1 kHz"
    header = (
        "scenes", "policy", "rows", "strict barrier below 0", "least strict h [mm]",
        "least h of speed [mm/s]", "VIOLATED", "BACKUP", "goals",
    )  # fmt: skip
    lines = [
        (
            r["scenes"], r["policy"], r["rows"], str(r["entered"]), f"{1e3 * r['least_h']:+.3f}",
            f"{1e3 * r['least_speed_h']:+.3f}", str(r["violated"]), str(r["backup"]),
            f"{r['goals']:.1%}",
        )
        for r in results
    ]  # fmt: skip
    return {"held-rows": Table(title, header, lines)}


def episode(family: str, policy: str, rows: str, episodes: int) -> dict[str, Any]:
    """Run one policy in many scenes at once.

    Args:
        family: "random" or "random-moving".
        policy: one of `POLICIES`.
        rows: one of `SETTINGS`.
        episodes: how many scenes.
    """
    seeds = range(FIRST_SEED, FIRST_SEED + episodes)
    scenes = [scenarios.make(family, np.random.default_rng(seed)) for seed in seeds]
    now = Situation(scenes, np.random.default_rng(FIRST_SEED))
    settings, margin = SETTINGS[rows]
    batch, barriers = programs.make_batch("lex-cbf-qp", input_set=U), now.barriers
    least = barriers.values(now.x, np.zeros(episodes))
    reached, violated = np.zeros(episodes, dtype=np.bool_), np.zeros(episodes, dtype=np.bool_)
    backup, inside = 0, np.zeros_like(least)
    for step in range(STEPS):
        t = np.full(episodes, step * DT)
        wanted = U.project(POLICIES[policy](now, t))
        result = batch(wanted, barriers.rows(now.x, t, settings, margin))
        violated |= result.status == FilterStatus.VIOLATED
        backup += int((result.status == FilterStatus.BACKUP).sum())
        advance(barriers.kind, barriers.parameters, now.x, t, result.u, DT, LOOKS, least, inside)
        reached |= np.linalg.norm(now.x[:, :2] - now.goal, axis=1) <= scenes[0].goal_radius
    position = np.where(now.strict, least, np.inf).min(axis=1)
    return {
        "scenes": family,
        "policy": policy,
        "rows": rows,
        "episodes": episodes,
        "entered": int((np.minimum(position, least[:, -1]) < 0.0).sum()),
        "least_h": float(position.min()),
        "least_speed_h": float(least[:, -1].min()),
        "violated": int(violated.sum()),
        "backup": backup,
        "goals": float(reached.mean()),
    }
