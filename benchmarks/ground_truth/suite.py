"""How much do filters change, and what do they miss? Beside the exact kernel of held inputs.

States are drawn from the kernel, inputs from U. Needless is a change of an input that the kernel
permits. Closed loops are driven straight at the region, and by inputs that jump between corners.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from benchmarks.common import parallel, table
from benchmarks.ground_truth import filters, reachable, truths
from benchmarks.ground_truth.filters import LEAST, OURS, PEERS, RANKED, Filter
from benchmarks.ground_truth.truths import PERIOD, REACH, Truth, advance, least
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
    n, pairs = (200, 100) if quick else (4000, 1500)
    ours = [name for name, options in RANKED.items() if filters.exists(options)]
    alone = [*(name for name in ours if name in OURS), *PEERS, LEAST]
    x = truths.disc().sample(n // 4, SPEEDS[1], np.random.default_rng(0))
    return {
        "alone": parallel(
            alone_figures, ((t, f, speed, n) for t in TRUTHS for f in alone for speed in SPEEDS)
        ),
        "tempo": parallel(tempo_figures, ((name,) for name in alone)),
        "ranks": parallel(ranks_figures, ((name, pairs) for name in (*ours, *PEERS))),
        "grid": reachable.beside_the_search(x, quick),
    }  # fmt: skip


def alone_figures(truth: str, name: str, speed: float, n: int) -> dict[str, Any]:
    """Return what a filter does with n states of a kernel that are no faster than `speed`."""
    known, rng = TRUTHS[truth](), np.random.default_rng(0)
    make = filters.by_name(name, [known.condition], known)
    x, wanted = known.sample(n, speed, rng), rng.uniform(-REACH, REACH, (n, 2))
    one = make(n)
    times = []
    for _ in range(4):  # in the first some compile
        one.reset(x)
        start = time.perf_counter()
        u = one(x, wanted)
        times.append(time.perf_counter() - start)
    accepted = one.accepts(x)
    permitted = known.is_safe(x, wanted)
    changed = np.abs(u - wanted).max(axis=1) > 1e-6
    # of the filter's own input: a tolerance, as the best one may end on the kernel's border
    after = known.value(advance(x, u)) < -1e-6
    out = after | (least(x, u, known.h) < -1e-6)
    ran = np.min([closed_loop(make(n), x, known, w)[0] for w in _inputs(known, n)], axis=0)
    entered = ran < ENTERED
    return {
        "truth": truth, "filter": name, "speed": speed, "states": n,
        "cover": accepted.mean(), "needless": (changed & permitted).sum() / permitted.sum(),
        "false_accepts": out[accepted].sum(), "accepted": accepted.sum(),
        "entered_own": entered[accepted].sum(), "entered": entered.sum(),
        "us": 1e6 * np.median(times[1:]) / n,
    }  # fmt: skip


def _inputs(known: Truth, n: int) -> Iterator[Any]:
    """Yield the hostile inputs, (step, states) → (N, 2)."""
    yield lambda k, x: known.aim(x)
    jumps = np.random.default_rng(1).choice([-REACH, REACH], (STEPS // HELD, n, 2))
    yield lambda k, x: jumps[k // HELD]


def closed_loop(one: Filter, x: Array, known: Truth, wanted: Any) -> tuple[Array, Array]:
    """Return the least h (N,) of loops from states (N, 4), and where they end."""
    one.reset(x)
    lowest = known.h(x[:, :2])
    for k in range(STEPS):
        u = one(x, wanted(k, x))
        lowest, x = np.minimum(lowest, least(x, u, known.h)), advance(x, u)
    return lowest, x


def tempo_figures(name: str) -> dict[str, Any]:
    """Return the time of a 10 m sprint to 5 cm before a wall, and from rest to 95 % of a limit."""
    known = truths.wall()
    one, x = filters.by_name(name, [known.condition], known)(1), np.array([[10.0, 0.0, 0.0, 0.0]])
    one.reset(x)
    sprint, rise = 0, 0
    while x[0, 0] > 0.05 and sprint < 2000:
        x, sprint = advance(x, one(x, known.aim(x))), sprint + 1
    if name in OURS:
        limited, y = filters.by_name(name, [SpeedLimit("limit", 1, 1.0)])(1), np.zeros((1, 4))
        limited.reset(y)
        while y[0, 2] < 0.95 and rise < 500:
            y, rise = advance(y, limited(y, np.array([[REACH, 0.0]]))), rise + 1
    return {"filter": name, "sprint": PERIOD * sprint, "rise": PERIOD * rise or None}


def ranks_figures(name: str, n: int) -> dict[str, Any]:
    """Return how often a filter enters two overlapping discs that it could avoid."""
    rng = np.random.default_rng(0)
    conditions, heights = truths.pair()
    x = np.vstack([truths.sample_pair(n // 2, speed, rng) for speed in SPEEDS])
    known, make = truths.pair_of(x), filters.by_name(name, conditions)
    middle, deepest = np.array([0.5 * truths.ASIDE, 0.0]), np.full((2, len(x)), np.inf)
    jumps = np.random.default_rng(1).choice([-REACH, REACH], (10, len(x), 2))
    for mode in range(2):
        one, z = make(len(x)), x.copy()
        one.reset(z)
        for k in range(10 * HELD):
            wanted = jumps[k // HELD] if mode else truths.to_border(middle - z[:, :2])
            u = one(z, wanted)
            deepest = np.minimum(deepest, [least(z, u, h) for h in heights])
            z = advance(z, u)
    (first, second), avoidable, both = deepest < DEEPER, known.first >= 0.0, known.both >= 0.0
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

    alone = {
        "filter": "{filter}", "cover": pair("cover", 3), "needless": pair("needless", 3),
        "false accepts": sums("false_accepts", "accepted"),
        "entered from its own set": sums("entered_own", "accepted"),
        "entered from the kernel": sums("entered", "states"), "µs a state": pair("us", 1),
    }  # fmt: skip
    tempo = {
        "filter": "{filter}", "10 m sprint [s]": "{sprint:.2f}",
        "rest to 0.95 m/s [s]": lambda row: "" if row["rise"] is None else f"{row['rise']:.2f}",
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
