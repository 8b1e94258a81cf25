"""Held rows in random scenes: no policy may get past a strict barrier, and PD must still arrive.

The reduced-order environment at 50 Hz in its filter, lex-cbf-qp without margins. What the filter
applies is followed anew, and looked at every millisecond.
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.common import parallel, table
from benchmarks.random_conflicts import advance
from hcbf_gym import wrappers
from hcbf_gym.arrays import Array, Mask
from hcbf_gym.envs.task import CONTROL_DT, MAX_EPISODE_STEPS
from hcbf_gym.evaluation.statistics import BOUNDED, counted
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.policies import PDTracker
from hcbf_gym.programs import FilterStatus

LOOKS = 20  # Looks in a control step
FIRST_SEED = 50_000
NOISE = 3.0  # Standard deviation of what is added to PD in the policy "noise" [m/s²]

SETTINGS: dict[str, dict[str, Any]] = {  # What the filter is given, by name
    "held": {"rows": "held", "margin": 0.0},
    "usual": {"rows": "usual", "margin": 0.0},
    "usual + 1 cm": {"rows": "usual", "margin": 0.01},
}


class Situation:
    """What a policy sees of N scenes."""

    def __init__(self, env: wrappers.VectorSafetyFilter, rng: np.random.Generator):
        self._inner: Any = env.unwrapped
        self._pd = PDTracker.for_env(env)
        self.barriers = self._inner.barrier_set
        self.strict = self.barriers.keeps_margin == 1.0
        self.reach = self._inner.scenario.input_set.radius
        self.rng, count = rng, len(self.strict)
        self.sign, self.corner = np.ones(count), np.zeros((count, 2))

    def look(self, observation: Array, info: dict[str, Any]) -> None:
        """Take in what the environment returned last."""
        self.x, self.t = self._inner.rom_state, self._inner.time
        self.wanted = np.asarray(self._pd(observation, info), dtype=np.float64)

    def nearest_normals(self) -> tuple[Array, Array]:
        """Return (N, 2) ∇h of the nearest strict barrier, and of the second nearest."""
        h, sensed = self.barriers.sense(self.x, self.t)
        order = np.argsort(np.where(self.strict, h, np.inf), axis=1)
        every = np.arange(len(h))
        return sensed[every, order[:, 0], 1:3], sensed[every, order[:, 1], 1:3]

    def turn(self, mean: float) -> Mask:
        """Return (N,) who changes its mind in this step, every `mean` seconds on average."""
        return self.rng.random(len(self.sign)) < CONTROL_DT / mean


def _along_the_edge(now: Situation) -> Array:
    normal = now.nearest_normals()[0]
    now.sign[now.turn(0.8)] *= -1.0
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    return now.reach * (now.sign[:, None] * tangent - normal)


def _into_the_corner(now: Situation) -> Array:
    first, second = now.nearest_normals()
    return -now.reach * (first + 0.9 * second)


def _away_and_back(now: Situation) -> Array:
    now.sign[now.turn(0.6)] *= -1.0
    return now.reach * now.sign[:, None] * now.nearest_normals()[0]


def _bang_bang(now: Situation) -> Array:
    changes = now.turn(0.3)
    now.corner[changes] = now.reach * now.rng.choice([-1.0, 1.0], (int(changes.sum()), 2))
    return now.corner


POLICIES: dict[str, Callable[[Situation], Array]] = {
    "pd": lambda now: now.wanted,
    "noise": lambda now: now.wanted + now.rng.normal(0.0, NOISE, now.wanted.shape),
    "at the nearest region": lambda now: -now.reach * now.nearest_normals()[0],
    "into the corner": _into_the_corner,
    "along the edge, reversing": _along_the_edge,
    "away and back": _away_and_back,
    "bang-bang": _bang_bang,
}
"""Friendly, disturbed, and hostile ones, which push with all that U allows."""


def run(quick: bool) -> dict[str, Any]:
    """Run every policy under held rows, and PD under the usual ones; return figures."""
    cases = [
        (family, policy, rows, 50 if quick else 1000)
        for family in ("random", "random-moving")
        for policy in POLICIES
        for rows in (SETTINGS if policy == "pd" else ("held",))
    ]
    return {"held_rows": parallel(walk_all, cases)}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the one table: a line for each family of scenes, policy and kind of rows."""
    results = figures["held_rows"]
    title = f"lex-cbf-qp, {results[0]['episodes']} scenes a row, 20 s each, looked at at 1 kHz"
    columns = {
        "scenes": "{scenes}", "policy": "{policy}", "rows": "{rows}",
        f"strict barrier below 0 ({BOUNDED})": lambda r: counted(r["entered"], r["episodes"]),
        "least strict h [mm]": lambda r: f"{1e3 * r['least_h']:+.3f}",
        "least h of speed [mm/s]": lambda r: f"{1e3 * r['least_speed_h']:+.3f}",
        "VIOLATED": "{violated}", "BACKUP": "{backup}", "goals": "{goals:.1%}",
    }  # fmt: skip
    return {"held-rows": table(title, results, columns)}


def walk_all(family: str, policy: str, rows: str, episodes: int) -> dict[str, Any]:
    """Run one policy in many scenes at once, each for 20 s."""
    bare = gym.make_vec(
        "HCBF-Regions-v0", num_envs=episodes, scenario=family, autoreset_mode="Disabled"
    )
    env = wrappers.VectorSafetyFilter(bare, program="lex-cbf-qp", **SETTINGS[rows])
    inner: Any = env.unwrapped
    observation, info = env.reset(seed=FIRST_SEED)
    now = Situation(env, np.random.default_rng(FIRST_SEED))
    least, gap, radius = info["h"].copy(), 0.0, inner.scenes[0].goal_radius
    reached, violated = np.zeros(episodes, dtype=np.bool_), np.zeros(episodes, dtype=np.bool_)
    backup = 0
    for _ in range(MAX_EPISODE_STEPS):
        now.look(observation, info)
        observation, _, _, _, info = env.step(POLICIES[policy](now))
        report, x = info["safety_filter"], now.x
        violated |= report["status"] == FilterStatus.VIOLATED
        backup += int((report["status"] == FilterStatus.BACKUP).sum())
        advance(now.barriers, x, now.t, report["u_safe"], CONTROL_DT, LOOKS, least)
        gap = max(gap, float(np.abs(x - inner.rom_state).max()))
        reached |= np.linalg.norm(x[:, :2] - inner.goal, axis=1) <= radius
    env.close()
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
        "gap": gap,
    }
