"""What `SafetyFilter` adds to a step in a user's loop, in turn with cbfpy's whole filter.

cbfpy runs with what its documentation recommends: 64 bit, one thread of Eigen, compiled; both are
pinned to one core and take turns, so that they see the same machine.
"""

import os
import time
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np

import hcbf_gym  # noqa: F401 - registers the environments
from benchmarks import peers
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.wrappers import SafetyFilter

PROGRAMS = ("h-cbf-qp", "eh-cbf-qp", "lex-cbf-qp")
SCENE: dict[str, Any] = {
    "name": "four rows",
    "barriers": [
        {
            "kind": "half-plane",
            "name": "wall",
            "priority": 1,
            "normal": [-1.0, 0.0],
            "offset": -1.0,
        },
        {"kind": "disc", "name": "a", "priority": 1, "center": [-2.0, 0.2], "radius": 1.0},
        {"kind": "disc", "name": "b", "priority": 2, "center": [0.3, 0.2], "radius": 0.8},
        {"kind": "disc", "name": "c", "priority": 3, "center": [-0.3, -0.6], "radius": 0.6},
    ],
    "reference": {"kind": "point", "goal": [3.0, 3.0]},
}
"""A wall and three discs; at the origin b and c contradict each other, far away nothing binds."""

Timed = tuple[Callable[[], Any], Callable[[], Any]]
"""A call to be timed, and what prepares it."""
PLACES = {"idle": (-50.0, -50.0), "conflict": (0.0, 0.0)}


def run(quick: bool) -> dict[str, Any]:
    """Time every program idle and in conflict; return medians [µs] and their ratios to cbfpy's."""
    rounds = 200 if quick else 4000
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    try:
        return _figures(rounds)
    finally:
        os.sched_setaffinity(0, allowed)


def _figures(rounds: int) -> dict[str, Any]:
    peer = peers.cbfpy_filter()
    rows = []
    for program in PROGRAMS:
        for place, position in PLACES.items():
            bare, filtered = _steps(program, position)
            times = in_turn([bare, filtered, (lambda: None, peer)], rounds)
            added = times[1] - times[0]
            rows.append(
                {
                    "program": program,
                    "place": place,
                    "bare": times[0],
                    "added": added,
                    "cbfpy": times[2],
                    "ratio": added / times[2],
                }
            )
    return {"filter": rows}


def _steps(program: str, position: tuple[float, float]) -> tuple[Timed, Timed]:
    """Return a bare step and a filtered one, both from rest at the same place."""
    u = np.array([0.5, 0.5], dtype=np.float32)
    scene = SCENE | {"start": list(position)}
    bare = gym.make("HCBF-Regions-v0", scenario=scene).unwrapped
    filtered = SafetyFilter(gym.make("HCBF-Regions-v0", scenario=scene).unwrapped, program=program)
    return (bare.reset, lambda: bare.step(u)), (filtered.reset, lambda: filtered.step(u))


def in_turn(calls: Sequence[Timed], rounds: int) -> list[float]:
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
    return (1e6 * np.median(times, axis=0)).tolist()


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the table of what each program adds."""
    header = ("program", "where", "step [µs]", "added [µs]", "cbfpy [µs]", "share of cbfpy's")
    rows = [
        (
            row["program"],
            row["place"],
            f"{row['bare']:.0f}",
            f"{row['added']:.1f}",
            f"{row['cbfpy']:.0f}",
            f"{row['ratio']:.2f}",
        )
        for row in figures["filter"]
    ]
    return {"added": Table("what SafetyFilter adds to a step, four rows", header, rows)}
