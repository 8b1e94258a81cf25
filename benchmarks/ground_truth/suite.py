"""How much do filters change, and what do they miss? Beside the exact kernel of held inputs.

States are drawn from the kernel, inputs from U. Needless is a change of an input that the kernel
permits. Closed loops are driven straight at the region, and by inputs that jump between corners.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.common import parallel, table
from benchmarks.ground_truth import filters, reachable, truths
from benchmarks.ground_truth.filters import LEAST, OURS, PEERS, RANKED
from benchmarks.ground_truth.truths import PERIOD, REACH, advance, least
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import SpeedLimit
from hcbf_gym.evaluation.statistics import BOUNDED, counted
from hcbf_gym.evaluation.tables import Table

SPEEDS = (1.0, 3.0)  # of the states [m/s]
TRUTHS = {"half-plane": truths.wall, "disc": truths.disc}
STEPS, HELD = 150, 10  # of a closed loop, and how many periods an input of it is held for
ENTERED = -1e-4  # least h [m] from which on a loop counts as entered
DEEPER = -2e-3  # the same where the kernel is searched in two pieces


def run(quick: bool) -> dict[str, Any]:
    """Return the figures of every filter, of the ranks, and of the grid."""
    n, pairs = (100, 100) if quick else (10_000, 1500)
    alone = [*OURS, *PEERS, LEAST]
    x = truths.disc().sample(n // 4, SPEEDS[1], np.random.default_rng(0))
    return {
        "alone": parallel(
            alone_figures, ((t, f, speed, n) for t in TRUTHS for f in alone for speed in SPEEDS)
        ),
        "tempo": parallel(tempo_figures, ((name,) for name in alone)),
        "ranks": parallel(ranks_figures, ((name, pairs) for name in (*RANKED, *PEERS))),
        "grid": reachable.beside_the_search(x, quick),
    }  # fmt: skip


def alone_figures(truth: str, name: str, speed: float, n: int) -> dict[str, Any]:
    """Return what a filter does with n states of a kernel that are no faster than `speed`."""
    known, rng, times = TRUTHS[truth](), np.random.default_rng(0), []
    x, wanted = known.sample(n, speed, rng), rng.uniform(-REACH, REACH, (n, 2))
    u, accepted = filters.begin(name, [known.condition], x, known)(x, wanted)  # some compile
    for _ in range(3):
        step = filters.begin(name, [known.condition], x, known)
        start = time.perf_counter()
        step(x, wanted)
        times.append(time.perf_counter() - start)
    permitted, changed = known.permits(x, wanted), np.abs(u - wanted).max(axis=1) > 1e-6
    # a tolerance, as the best input may end on the kernel's border
    out = np.minimum(known.value(advance(x, u)), least(x, u, known.h)) < -1e-6
    loops = (
        closed_loop(name, [known.condition], [known.h], x, w, STEPS, known)
        for w in (lambda k, x: known.aim(x), jumping(n))
    )
    entered = np.min([one[0] for one in loops], axis=0) < ENTERED
    return {
        "truth": truth, "filter": name, "speed": speed, "states": n,
        "cover": accepted.mean(), "needless": (changed & permitted).sum() / permitted.sum(),
        "false_accepts": out[accepted].sum(), "accepted": accepted.sum(),
        "entered_own": entered[accepted].sum(), "entered": entered.sum(),
        "us": 1e6 * np.median(times) / n,
    }  # fmt: skip


def jumping(n: int) -> Callable[[int, Array], Array]:
    """Return inputs that jump between the corners of U."""
    jumps = np.random.default_rng(1).choice([-REACH, REACH], (STEPS // HELD, n, 2))
    return lambda k, x: jumps[k // HELD]


def closed_loop(
    name: str, conditions: Any, heights: Any, x: Array, wanted: Any, steps: int, truth: Any = None
) -> Array:
    """Return the least h (k, N) of k conditions in loops from states (N, 4)."""
    step, lowest = (
        filters.begin(name, conditions, x, truth),
        np.full((len(heights), len(x)), np.inf),
    )
    for k in range(steps):
        u, _ = step(x, wanted(k, x))
        lowest = np.minimum(lowest, [least(x, u, h) for h in heights])
        x = advance(x, u)
    return lowest


def tempo_figures(name: str) -> dict[str, Any]:
    """Return the time of a 10 m sprint to 5 cm before a wall, and from rest to 95 % of a limit."""
    known, x, y = truths.wall(), np.array([[10.0, 0.0, 0.0, 0.0]]), np.zeros((1, 4))
    rise, path, step = 0, [x], filters.begin(name, [known.condition], x, known)
    while len(path) < 1000:
        path.append(advance(path[-1], step(path[-1], known.aim(x))[0]))
    left = np.array(path)[:, 0, 0]
    sprint = PERIOD * np.argmax(left < 0.05) if left.min() > ENTERED else None
    if name in OURS:
        step = filters.begin(name, [SpeedLimit("limit", 1, 1.0)], y)
        while y[0, 2] < 0.95 and rise < 500:
            y, rise = advance(y, step(y, np.array([[REACH, 0.0]]))[0]), rise + 1
    return {"filter": name, "sprint": sprint, "rise": PERIOD * rise or None}


def ranks_figures(name: str, n: int) -> dict[str, Any]:
    """Return how often a filter enters two overlapping discs that it could avoid."""
    rng = np.random.default_rng(0)
    conditions, heights = truths.pair()
    x = np.vstack([truths.sample_pair(n // 2, speed, rng) for speed in SPEEDS])
    avoidable, both = (value >= 0.0 for value in truths.pair_values(x))
    middle = np.array([0.5 * truths.ASIDE, 0.0])
    first, second = np.min(
        [
            closed_loop(name, conditions, heights, x, wanted, 100)
            for wanted in (lambda k, x: truths.to_border(middle - x[:, :2]), jumping(len(x)))
        ],
        axis=0,
    ) < DEEPER  # fmt: skip
    conflict = avoidable & ~both
    return {
        "filter": name, "states": len(x),
        "avoidable": avoidable.sum(), "first": (first & avoidable).sum(),
        "both": both.sum(), "second": (second & both).sum(),
        "conflicts": conflict.sum(), "first_in_conflict": (first & conflict).sum(),
    }  # fmt: skip


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the tables of docs/how_much.md and docs/programs.md."""

    def pair(key: str, digits: int) -> Callable[[Any], str]:
        return lambda row: " / ".join(f"{one[key]:.{digits}f}" for one in row["of"])

    def sums(key: str, of: str) -> Callable[[Any], str]:
        return lambda row: counted(*(sum(one[k] for one in row["of"]) for k in (key, of)))

    def counts(key: str, of: str) -> Callable[[Any], str]:
        return lambda row: counted(row[key], row[of])

    def seconds(key: str, otherwise: str) -> Callable[[Any], str]:
        return lambda row: otherwise if row[key] is None else f"{row[key]:.2f}"

    alone = {
        "filter": "{filter}", "cover": pair("cover", 3), "needless": pair("needless", 3),
        "false accepts": sums("false_accepts", "accepted"),
        "entered from its own set": sums("entered_own", "accepted"),
        "entered from the kernel": sums("entered", "states"), "µs a state": pair("us", 1),
    }  # fmt: skip
    tempo = {
        "filter": "{filter}", "10 m sprint [s]": seconds("sprint", "enters the wall"),
        "rest to 0.95 m/s [s]": seconds("rise", ""),
    }  # fmt: skip
    ranks = {
        "filter": "{filter}",
        "enters rank 1, avoidable": counts("first", "avoidable"),
        "enters rank 2, both avoidable": counts("second", "both"),
        "enters rank 1 in a conflict": counts("first_in_conflict", "conflicts"),
    }
    grid = {
        "grid of p, v": "{grid[0]}² × {grid[1]}²", "its error, the band [m]": "{band:.3f}",
        "states, beyond the band": "{states}, {decided}",
        "in it by the grid alone": "{search_missed}", "by the search alone": "{search_more}",
    }  # fmt: skip
    found = {}
    for truth in TRUTHS:
        of = [row for row in figures["alone"] if row["truth"] == truth]
        names = dict.fromkeys(row["filter"] for row in of)
        rows = [{"filter": n, "of": [row for row in of if row["filter"] == n]} for n in names]
        title = f"{truth}, {of[0]['states']} states each of v ≤ 1 / v ≤ 3 m/s; {BOUNDED}"
        found[truth] = table(title, rows, alone)
    n, conflicts = (figures["ranks"][0][key] for key in ("states", "conflicts"))
    title = f"two overlapping discs, {n} states, {conflicts} of them in a conflict"
    return found | {
        "tempo": table("free driving", figures["tempo"], tempo),
        "ranks": table(f"{title}; {BOUNDED}", figures["ranks"], ranks),
        "grid": table("the kernel of the disc", [figures["grid"]], grid),
    }
