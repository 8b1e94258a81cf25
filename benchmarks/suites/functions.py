"""Users' functions beside the analytic shapes: how far their rows are apart, and how fast they are.

One core, processor time, medians. cbfpy takes turns with one call of rows for four functions.
"""

import functools
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks import peers
from benchmarks.common import in_turn, median, nothing, one_core, table
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

SHAPES: dict[str, tuple[Barrier, Scalar]] = {  # built-in ones, and the same as users write them
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
    with one_core():
        batches = [batch(name, [name] * 4, 3 if quick else 25) for name in SHAPES]
        batches.append(batch("all three", list(SHAPES), 3 if quick else 25))
        few = 20 if quick else 500
        call = one_call(100 if quick else 4000)
        return {"batches": batches, "call": call, "own": own(few), "arm": arm(few)}


def batch(label: str, names: list[str], rounds: int) -> dict[str, Any]:
    """Return the rate of rows of many states, and how far they are from the shapes' own."""
    shapes = [SHAPES[name][0] for name in names]
    functions = [Function(f"{name} {k}", 1, SHAPES[name][1]) for k, name in enumerate(names)]
    rows = GeneralRows(DoubleIntegrator(), LogClassK(), LinearClassK(2.0))
    x = np.random.default_rng(0).uniform(-3.0, 3.0, (BATCH, 4))
    t = np.zeros(BATCH)
    ours = rows(functions, x, t)
    seconds = 1e-6 * median(lambda: rows(functions, x, t), rounds, time.process_time)
    apart = 0.0
    for k in range(0, BATCH, BATCH // 64):
        theirs = rows(shapes, x[k], 0.0)
        for mine, analytic in ((ours.a[k], theirs.a), (ours.b[k], theirs.b)):
            apart = max(apart, float(np.abs(mine - analytic).max()))
    rate = len(names) * BATCH / seconds
    return {"functions": label, "rows_per_second": rate, "apart": apart}


def one_call(rounds: int) -> dict[str, float]:
    """Return the time of one state's rows of four functions [µs], and that of cbfpy's filter."""
    names = ("half-plane", "disc", "half-plane", "disc")
    functions = [Function(f"{name} {k}", 1, SHAPES[name][1]) for k, name in enumerate(names)]
    rows = GeneralRows(DoubleIntegrator(), LogClassK(), LinearClassK(2.0))
    x = np.array([0.0, 0.0, 0.5, -0.2])

    calls = [(nothing, lambda: rows(functions, x, 0.0)), (nothing, peers.cbfpy_filter())]
    ours, cbfpy = in_turn(calls, rounds)
    return {"rows": ours, "cbfpy": cbfpy}


def own(rounds: int) -> list[dict[str, Any]]:
    """Return the time of rows of a disc in Python beside that of the built-in one [µs a state]."""
    figures: list[dict[str, Any]] = []
    for count in (1, 256):
        x = np.random.default_rng(0).uniform(1.0, 3.0, (count, 4))
        held = RowSettings(period=0.02, u_max=7.1)
        figures.append({"states": count})
        built_in = Disc("disc", 1, (0.0, 0.0), 1.0)
        for name, disc in (("own", Round("disc", 1)), ("built_in", built_in)):
            scenes = BarrierSet([[disc]] * count)
            call = functools.partial(planar_rows, scenes, x, np.zeros(count), held)
            figures[-1][name] = median(call, rounds, time.thread_time) / count
    return figures


def arm(rounds: int) -> float:
    """Return how many rows a second the arm's clearances make, one state at a time."""
    module = example("arm")
    barriers = module.make().get_wrapper_attr("plant").barriers
    rows, q = GeneralRows(SingleIntegrator(6), LogClassK(), LinearClassK(2.0)), np.full(6, 0.3)
    return len(barriers) / median(lambda: rows(barriers, q, 0.0), rounds, time.thread_time) * 1e6


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the tables of docs/rows.md."""
    call, per_row = figures["call"], 1e6 / figures["arm"]
    batches = {"functions": "{functions}",
               "million rows/s": lambda row: f"{row['rows_per_second'] / 1e6:.1f}",
               "apart from the shape's own rows": "{apart:.0e}"}  # fmt: skip
    calls = [("rows of four functions", f"{call['rows']:.0f}"),
             ("cbfpy's whole filter, two rows", f"{call['cbfpy']:.0f}")]  # fmt: skip
    own = [
        (f"a disc in Python, {r['states']} states", f"{r['own']:.1f}", f"{r['built_in']:.1f}")
        for r in figures["own"]
    ]
    own.append(("a link of the arm and a sphere, Pinocchio's Jacobian", f"{per_row:.1f}", ""))
    header, title = ("row", "µs", "the built-in shape's"), "a user's own Barrier subclass"
    in_batches = "barriers.Function in batches of 16,384 states"
    return {
        "functions-own": Table(title, header, own),
        "functions": table(in_batches, figures["batches"], batches),
        "functions-call": Table("one call", ("what", "µs"), calls),
    }
