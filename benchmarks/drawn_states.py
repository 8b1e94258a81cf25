"""States for the programs to filter: rows of scenes, of conflicts, and of degenerate kinds."""

from typing import Any

import numpy as np

from hcbf_gym import scenarios
from hcbf_gym.barriers.rows import RowSettings
from hcbf_gym.barriers.set import BarrierSet

GROUP = 250
"""States that share the number of rows."""
FAMILIES = ("random", "random-moving", "paper-simulation", "conflicts", "steep", "graded")
"""Where rows come from: scenes; states inside several regions; gradients from .03 to 30; gradients
that differ by up to 1e9 within one level."""


def pool_of_scenes() -> dict[str, list[Any]]:
    """Return barriers of the package's own scenes by family."""
    rng = np.random.default_rng(0)
    made = {name: [scenarios.make(name, rng) for _ in range(60)] for name in FAMILIES[:2]}
    made["paper-simulation"] = [scenarios.make("paper-simulation")]
    return {name: [list(one.barriers) for one in scenes] for name, scenes in made.items()}


def draw(rng: np.random.Generator, family: str, pool: dict[str, list[Any]]) -> dict[str, Any]:
    """Return the rows of a group's states and their nominal inputs."""
    m = int(rng.integers(1, 13))
    drawn = _degenerate(rng, m) if family == "graded" else _of_scenes(rng, family, m, pool)
    if family == "steep":
        factor = 10.0 ** rng.uniform(-1.5, 1.5, (GROUP, m))
        drawn |= {"a": drawn["a"] * factor[..., None], "b": drawn["b"] * factor}
    levels = rng.integers(0, rng.integers(1, m + 1, (GROUP, 1)), (GROUP, m))
    ranks = np.stack([np.unique(p, return_inverse=True)[1] for p in levels]) + 1
    drawn["priority"] = ranks.astype(np.int64)
    u = rng.normal(0.0, 3.0, (GROUP, 2)) * rng.choice([1.0, 30.0], (GROUP, 1), p=[0.85, 0.15])
    return drawn | {"u_nominal": u}


def _of_scenes(
    rng: np.random.Generator, family: str, m: int, pool: dict[str, list[Any]]
) -> dict[str, Any]:
    """Return rows of m barriers of one scene, or of several where one has fewer."""
    scenes = pool[family] if family in pool else [*pool["random"], *pool["random-moving"]]
    chosen, x = [], np.empty((GROUP, 4))
    for i in range(GROUP):
        barriers = list(scenes[rng.integers(len(scenes))])
        while len(barriers) < m:
            barriers += scenes[rng.integers(len(scenes))]
        barriers = [barriers[k] for k in rng.permutation(len(barriers))[:m]]
        chosen.append(tuple(barriers))
        places = [_place(barrier) for barrier in barriers]
        places = [place for place in places if place is not None]
        spread = 0.15 if family == "conflicts" else 0.8
        middle = np.mean(places[:2], axis=0) if places else np.zeros(2)
        x[i] = *(middle + rng.normal(0.0, spread, 2)), *rng.normal(0.0, 0.7, 2)
    held = rng.random() < 0.5
    settings = RowSettings(period=0.02, u_max=float(np.hypot(5.0, 5.0))) if held else RowSettings()
    rows = BarrierSet(chosen).rows(x, rng.uniform(0.0, 5.0, GROUP), settings)
    assert rows.alpha2_psi is not None
    return {"a": rows.a, "b": rows.b, "h": rows.h, "alpha2_psi": rows.alpha2_psi}


def _place(barrier: Any) -> Any:
    """Return the middle of a region, None for what has none."""
    if hasattr(barrier, "center"):
        return np.array(barrier.center, dtype=float)
    corners = getattr(barrier, "corners", getattr(barrier, "vertices", None))
    return None if corners is None or callable(corners) else np.mean(corners, axis=0)


def _degenerate(rng: np.random.Generator, m: int) -> dict[str, Any]:
    """Return rows with gradients down to 1e-9, zero rows, and exactly parallel copies."""
    direction = rng.normal(0.0, 1.0, (GROUP, m, 2))
    length = rng.lognormal(0.0, 0.7, (GROUP, m))
    a = direction * (length / np.linalg.norm(direction, axis=-1))[..., None]
    b = length * rng.normal(0.0, 4.0, (GROUP, m))
    kind = rng.choice(5, (GROUP, m), p=[0.6, 0.12, 0.05, 0.15, 0.08])
    faint = np.where(kind == 1, 10.0 ** rng.uniform(-9.0, -2.0, (GROUP, m)), 1.0)
    a, b = a * faint[..., None], b * np.where(rng.random((GROUP, m)) < 0.7, faint, 1.0)
    a[kind == 2] = 0.0
    index = np.arange(GROUP)
    for k in range(1, m):
        source = rng.integers(0, k, GROUP)
        factor = 2.0 ** rng.integers(-2, 3, GROUP) * rng.choice([-1.0, 1.0], GROUP)
        copied, same = kind[:, k] >= 3, kind[:, k] == 4
        a[:, k] = np.where(copied[:, None], factor[:, None] * a[index, source], a[:, k])
        b[:, k] = np.where(same, factor * b[index, source], b[:, k])
    h = rng.normal(0.0, 1.0, (GROUP, m))
    return {"a": a, "b": b, "h": h, "alpha2_psi": rng.normal(0.0, 2.0, (GROUP, m))}
