"""Users' functions beside the analytic shapes: how far their rows are apart, and how fast they are.

One core, processor time, medians. cbfpy takes turns with one call of rows for four functions.
"""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks import peers
from benchmarks.suites.filter import in_turn
from benchmarks.suites.foreign import example
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import (
    Barrier,
    BarrierSet,
    Disc,
    Function,
    HalfPlane,
    LinearClassK,
    LogClassK,
    PlanarBarrier,
    RowSettings,
    SpeedLimit,
)
from hcbf_gym.barriers.function import Scalar
from hcbf_gym.barriers.general import GeneralRows
from hcbf_gym.barriers.planar_rows import planar_rows
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.models import DoubleIntegrator, SingleIntegrator

SHAPES: dict[str, tuple[Barrier, Scalar]] = {
    "half-plane": (HalfPlane("wall", 1, (0.0, 1.0), -2.0), lambda x, t: x[1] + 2.0),
    "disc": (
        Disc("disc", 1, (2.0, 0.0), 1.0),
        lambda x, t: ((x[0] - 2.0) ** 2 + x[1] ** 2) ** 0.5 - 1.0,
    ),
    "speed limit": (
        SpeedLimit("speed", 1, 1.0),
        lambda x, t: 0.5 * (1.0 - x[2] ** 2 - x[3] ** 2),
    ),
}
"""Built-in ones, and the same as users write them."""
BATCH = 16_384


@dataclass(frozen=True)
class Round(PlanarBarrier):
    """A disc about the origin as a user would write it, in Python."""

    radius: float = 1.0

    def planar_jet(self, q: Array) -> tuple[float, Array, Array]:
        """Return H, ∇H and ∇²H."""
        distance = float(np.linalg.norm(q))
        n = q / distance
        return distance - self.radius, n, (np.eye(2) - np.outer(n, n)) / distance


def run(quick: bool) -> dict[str, Any]:
    """Return rates of batches, the largest difference from analytic rows, and one call's time."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    try:
        batches = [batch(name, [name] * 4, 3 if quick else 25) for name in SHAPES]
        batches.append(batch("all three", list(SHAPES), 3 if quick else 25))
        return {
            "batches": batches,
            "call": one_call(100 if quick else 4000),
            "own": own(20 if quick else 500),
            "arm": arm(20 if quick else 500),
        }
    finally:
        os.sched_setaffinity(0, allowed)


def batch(label: str, names: list[str], rounds: int) -> dict[str, Any]:
    """Return the rate of rows of many states, and how far they are from the shapes' own."""
    shapes = [SHAPES[name][0] for name in names]
    functions = [Function(f"{name} {k}", 1, SHAPES[name][1]) for k, name in enumerate(names)]
    rows = GeneralRows(DoubleIntegrator(), LogClassK(), LinearClassK(2.0))
    x = np.random.default_rng(0).uniform(-3.0, 3.0, (BATCH, 4))
    t = np.zeros(BATCH)
    ours = rows(functions, x, t)
    times = []
    for _ in range(rounds):
        began = time.process_time()
        rows(functions, x, t)
        times.append(time.process_time() - began)
    apart = 0.0
    for k in range(0, BATCH, BATCH // 64):
        theirs = rows(shapes, x[k], 0.0)
        for mine, analytic in ((ours.a[k], theirs.a), (ours.b[k], theirs.b)):
            apart = max(apart, float(np.abs(mine - analytic).max()))
    rate = len(names) * BATCH / float(np.median(times))
    return {"functions": label, "rows_per_second": rate, "apart": apart}


def one_call(rounds: int) -> dict[str, float]:
    """Return the time of one state's rows of four functions [µs], and that of cbfpy's filter."""
    names = ("half-plane", "disc", "half-plane", "disc")
    functions = [Function(f"{name} {k}", 1, SHAPES[name][1]) for k, name in enumerate(names)]
    rows = GeneralRows(DoubleIntegrator(), LogClassK(), LinearClassK(2.0))
    x = np.array([0.0, 0.0, 0.5, -0.2])

    def nothing() -> None:
        pass

    calls = [(nothing, lambda: rows(functions, x, 0.0)), (nothing, peers.cbfpy_filter())]
    ours, cbfpy = in_turn(calls, rounds)
    return {"rows": ours, "cbfpy": cbfpy}


def own(rounds: int) -> list[dict[str, float]]:
    """Return the time of rows of a disc in Python beside that of the built-in one [µs a state]."""
    figures = []
    for count in (1, 256):
        x = np.random.default_rng(0).uniform(1.0, 3.0, (count, 4))
        held = RowSettings(period=0.02, u_max=7.1)
        times = [
            _median(lambda: planar_rows(scenes, x, np.zeros(count), held), rounds) / count  # noqa: B023
            for scenes in (
                BarrierSet([[kind("disc", 1)]] * count)
                for kind in (Round, lambda name, rank: Disc(name, rank, (0.0, 0.0), 1.0))
            )
        ]
        figures.append({"states": count, "own": times[0], "built_in": times[1]})
    return figures


def arm(rounds: int) -> float:
    """Return how many rows a second the arm's clearances make, one state at a time."""
    module = example("arm")
    barriers = module.make().get_wrapper_attr("plant").barriers
    rows, q = GeneralRows(SingleIntegrator(6), LogClassK(), LinearClassK(2.0)), np.full(6, 0.3)
    return len(barriers) / _median(lambda: rows(barriers, q, 0.0), rounds) * 1e6


def _median(call: Callable[[], Any], rounds: int) -> float:
    """Return the median processor time of a call [µs]."""
    call()
    times = np.empty(rounds)
    for k in range(rounds):
        began = time.thread_time()
        call()
        times[k] = time.thread_time() - began
    return 1e6 * float(np.median(times))


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the table of docs/rows.md."""
    call = figures["call"]
    rows = [
        (r["functions"], f"{r['rows_per_second'] / 1e6:.1f}", f"{r['apart']:.0e}")
        for r in figures["batches"]
    ]
    header = ("functions", "million rows/s", "apart from the shape's own rows")
    calls = [("rows of four functions", f"{call['rows']:.0f}"),
             ("cbfpy's whole filter, two rows", f"{call['cbfpy']:.0f}")]  # fmt: skip
    own = [
        (f"a disc in Python, {r['states']} states", f"{r['own']:.1f}", f"{r['built_in']:.1f}")
        for r in figures["own"]
    ]
    per_row = 1e6 / figures["arm"]
    own.append(("a link of the arm and a sphere, Pinocchio's Jacobian", f"{per_row:.1f}", ""))
    return {
        "functions-own": Table(
            "a user's own Barrier subclass", ("row", "µs", "the built-in shape's"), own
        ),
        "functions": Table("barriers.Function in batches of 16,384 states", header, rows),
        "functions-call": Table("one call", ("what", "µs"), calls),
    }
