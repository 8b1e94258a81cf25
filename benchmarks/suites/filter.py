"""What `SafetyFilter` adds to a step in a user's loop, in turn with what cbfpy's filter adds to it.

Both have the same barriers and input set. For the ratio both have the same rows, too: linear α₁ and
α₂, as cbfpy has them by default, usual rows, no margin. Beside it stands what the filter adds as it
is shipped, with the paper's logarithm and rows for a held input. All are pinned to one core and
take turns, so that they see the same machine, in loops around the same environment, so that what
the environment does to the caches is done to both.
"""

import os
import time
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from benchmarks import peers
from benchmarks.blocks import Timed, blocks_in_turn
from benchmarks.shares import shares
from hcbf_gym.barriers import Disc, HalfPlane, to_dict
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.wrappers import SafetyFilter

PROGRAMS = ("h-cbf-qp", "eh-cbf-qp", "lex-cbf-qp")
ROW_COUNTS = (2, 5, 12)
PLACES = {"idle": (-50.0, -50.0), "conflict": (0.0, 0.0)}
SAME_ROWS: dict[str, Any] = {"alpha1": 1.0, "alpha2": 1.0, "rows": "usual", "margin": 0.0}
REPETITIONS = 5
WANTED = np.array([0.5, 0.5])

SHAPES = (  # At the origin the first two ask for opposite inputs; far away nothing binds
    Disc("strict", 1, (-0.3, -0.2), 0.33),
    Disc("against it", 2, (0.3, 0.2), 0.8),
    HalfPlane("wall", 1, (-1.0, 0.0), -1.0),
    Disc("left", 1, (-2.0, 0.2), 1.0),
    Disc("below", 3, (0.1, -1.2), 1.0),
    *(
        Disc(f"around {k}", 1 + k % 3, (2.5 * np.cos(k), 2.5 * np.sin(k)), 1.0 + 0.1 * k)
        for k in range(7)
    ),
)


def run(quick: bool) -> dict[str, Any]:
    """Time every program idle and in conflict; return medians [µs] and their ratios to cbfpy's."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    try:
        rows = [
            row
            for count in ROW_COUNTS
            for place in PLACES
            for row in _rows(count, place, 2 if quick else 40)
        ]
    finally:
        os.sched_setaffinity(0, allowed)
    return {"cbfpy": peers.settings(), "same_rows": SAME_ROWS, "filter": rows, "shares": shares()}


def _rows(count: int, place: str, blocks: int) -> list[dict[str, Any]]:
    """Return the figures of one scene at one place, a program each."""
    scene = {
        "name": f"{count} rows",
        "barriers": [to_dict(shape) for shape in SHAPES[:count]],
        "reference": {"kind": "point", "goal": [3.0, 3.0]},
        "start": list(PLACES[place]),
    }
    x = np.array([*PLACES[place], 0.0, 0.0])
    calls = [
        _step(_environment(scene)),
        _peers_step(_environment(scene), peers.cbfpy_filter(SHAPES[:count], x, WANTED)),
        *(_step(SafetyFilter(_environment(scene), name, **SAME_ROWS)) for name in PROGRAMS),
        *(_step(SafetyFilter(_environment(scene), name)) for name in PROGRAMS),
    ]
    times = np.array([blocks_in_turn(calls, blocks) for _ in range(REPETITIONS)])
    cbfpy, added = times[:, 1:2] - times[:, :1], times[:, 2:] - times[:, :1]
    medians, ratios = np.median(added, axis=0), np.median(added / cbfpy, axis=0)
    return [
        {
            "program": name,
            "rows": count,
            "place": place,
            "step": float(np.median(times[:, 0])),
            "cbfpy": float(np.median(cbfpy)),
            "added": float(medians[k]),
            "ratio": float(ratios[k]),
            "shipped": float(medians[k + len(PROGRAMS)]),
            "shipped_ratio": float(ratios[k + len(PROGRAMS)]),
        }
        for k, name in enumerate(PROGRAMS)
    ]


def _environment(scene: dict[str, Any]) -> gym.Env[Any, Any]:
    """Return an environment with no wrapper of Gymnasium's."""
    return gym.make("HCBF-Regions-v0", scenario=scene).unwrapped


def _step(env: gym.Env[Any, Any]) -> Timed:
    """Return how an episode begins, and its next step."""
    action = WANTED.astype(np.float32)
    return lambda: env.reset(seed=0), lambda: env.step(action)


def _peers_step(env: gym.Env[Any, Any], u: Callable[[], Any]) -> Timed:
    """Return how an episode begins, and its next step under a peer's input."""
    return lambda: env.reset(seed=0), lambda: env.step(u())


def in_turn(calls: Sequence[Timed], rounds: int) -> NDArray[np.float64]:
    """Return each call's median time [µs], without its preparation.

    The calls take turns, so that all see the same machine.
    """
    times = np.empty((rounds, len(calls)))
    for i in range(-1, rounds):  # the first round warms up
        for k, (prepare, call) in enumerate(calls):
            prepare()
            start = time.perf_counter()
            call()
            times[i, k] = time.perf_counter() - start
    return 1e6 * np.median(times, axis=0)


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the table of what each program adds."""
    versions = figures["cbfpy"]["versions"]
    header = (
        "program",
        "rows",
        "where",
        "cbfpy adds [µs]",
        "SafetyFilter adds [µs]",
        "share of that",
        "as shipped [µs]",
        "share of that",
    )
    rows = [
        (
            f"`{row['program']}`",
            str(row["rows"]),
            row["place"],
            f"{row['cbfpy']:.1f}",
            f"{row['added']:.1f}",
            f"{row['ratio']:.2f}",
            f"{row['shipped']:.1f}",
            f"{row['shipped_ratio']:.2f}",
        )
        for row in figures["filter"]
    ]
    title = (
        f"what SafetyFilter and cbfpy add to a step, in turn: cbfpy {versions['cbfpy']} "
        f"with ElastiQP {versions['elastiqp']}"
    )
    parts = [(row["part"], f"{row['time']:.1f}") for row in figures["shares"]]
    return {
        "added": Table(title, header, rows),
        "shares": Table("where that time goes, five rows, idle", ("part", "µs"), parts),
    }
