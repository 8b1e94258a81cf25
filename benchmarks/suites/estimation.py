"""How well the A1 knows where it is, and whether it knows how well."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from scipy.stats import chi2

from benchmarks.common import parallel, table
from hcbf_gym.arrays import Array
from hcbf_gym.estimation import PRESETS
from hcbf_gym.evaluation.tables import Table

SENSORS: dict[str, Any] = {  # What is compared: presets by their name, and fields of `Sensors`
    **dict.fromkeys(PRESETS),
    "fixes of 2 cm at 20 Hz, 40 ms late": {},
    "the same, drift 5 cm in 2 s": {"drift": 0.05, "drift_time": 2.0},
}

SPEED = 1.0  # Each component of the velocities that the robot is driven to, at most [m/s]


class Walk(NamedTuple):
    """One episode at the control times."""

    position: Array  # (k,) squared error of the position along both axes, summed [m²]
    velocity: Array  # (k,) of the velocity [m²/s²]
    nees: Array  # (k,) eᵀ P⁻¹ e, of position and velocity together
    fell: bool  # whether the robot fell


def run(quick: bool) -> dict[str, Any]:
    """Drive the A1 to random velocities on what it knows; return errors and consistency."""
    episodes, steps = (4, 100) if quick else (50, 200)
    jobs = [
        (name if fields is None else fields, range(episodes), steps)
        for name, fields in SENSORS.items()
    ]
    results = parallel(walk, jobs)
    return {"rows": [_row(name, walks) for name, walks in zip(SENSORS, results, strict=True)]}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the table of errors and consistency."""
    columns = {
        "sensors": "{sensors}",
        "position": lambda row: f"{100.0 * row['position_rms']:.2f} cm",
        "velocity": lambda row: f"{100.0 * row['velocity_rms']:.2f} cm/s",
        "NEES": "{nees:.2f}", "95 % band": "{low:.2f}–{high:.2f}",
        "instants inside": lambda row: f"{100.0 * row['share_inside']:.0f} %",
        "falls": "{fell} of {episodes}",
    }  # fmt: skip
    return {"all": table("what the A1 knows of itself", figures["rows"], columns)}


def walk(sensors: Any, seeds: Iterable[int], steps: int) -> list[Walk]:
    """Walk an episode for each seed."""
    options = {"estimation": sensors, "feedback": "measured"}
    env = gym.make("HCBF-A1Regions-v0", scenario="random", **options)
    walks = [_episode(env, seed, steps) for seed in seeds]
    env.close()
    return walks


def _episode(env: gym.Env, seed: int, steps: int) -> Walk:
    """Walk one episode in which the wanted velocity changes every .1 to 1 s."""
    inner: Any = env.unwrapped
    env.reset(seed=seed)
    rng = np.random.default_rng(seed)
    errors, nees, left, wanted, fell = [], [], 0, np.zeros(2), False
    for _ in range(steps):
        if left == 0:
            left, wanted = int(rng.integers(5, 50)), rng.uniform(-SPEED, SPEED, 2)
        left -= 1
        u = np.clip(5.0 * (wanted - inner.estimate.x[2:]), -5.0, 5.0)
        fell = bool(env.step(u.astype(np.float32))[4]["fallen"])
        if fell:
            break
        known = inner.estimate
        error = known.x - inner.simulation.base_state
        errors.append(error**2)
        nees.append(error @ np.linalg.solve(known.covariance, error))
    squares = np.array(errors).reshape(-1, 4)
    return Walk(squares[:, :2].sum(axis=1), squares[:, 2:].sum(axis=1), np.array(nees), fell)


def _row(name: str, walks: list[Walk]) -> dict[str, Any]:
    """Return the figures of one set of sensors; an episode with a fall counts as a fall alone."""
    upright = [w for w in walks if not w.fell]
    n = len(upright)
    # the mean of n independent NEES of 4 dimensions is χ² of 4n degrees of freedom over n
    low, high = (chi2.ppf([0.025, 0.975], 4 * n) / n).tolist()
    at_instants = np.mean([w.nees for w in upright], axis=0)
    inside = (low <= at_instants) & (at_instants <= high)
    return {
        "sensors": name,
        "position_rms": float(np.sqrt(np.mean([w.position for w in upright]))),
        "velocity_rms": float(np.sqrt(np.mean([w.velocity for w in upright]))),
        "nees": float(at_instants.mean()),
        "low": low,
        "high": high,
        "share_inside": float(inside.mean()),
        "fell": len(walks) - n,
        "episodes": len(walks),
    }
