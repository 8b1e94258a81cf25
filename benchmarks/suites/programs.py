"""Time of a filtered action, rows included: every program, single and batched, beside others.

cbfpy is measured in the same run where it is installed (the extra `benchmark`).
"""

import functools
import importlib.util
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from benchmarks.common import in_turn, nothing, table
from hcbf_gym import programs
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, Disc, HalfPlane, RowSettings
from hcbf_gym.barriers.planar_rows import planar_rows
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.programs import CbfRows

BATCH, QUICK_BATCH, ROWS = 4096, 256, 4


def run(quick: bool) -> dict[str, Any]:
    """Take all figures; times in µs, medians."""
    repeats, size = (50, QUICK_BATCH) if quick else (400, BATCH)
    figures: dict[str, Any] = {
        "single": _single(repeats),
        "batch": _batch(5 if quick else 25, size),
        "peers": _peers(repeats),
    }
    single, batch = figures["single"], figures["batch"]
    figures["batch_gain"] = {name: single[name] / batch[name] for name in batch}
    figures["actions_per_second"] = {name: 1e6 / batch[name] for name in batch}
    return figures


def scene(rng: np.random.Generator) -> tuple[Barrier, ...]:
    """Return `ROWS` barriers around the origin, of four priorities; about half are active."""
    barriers: list[Barrier] = [HalfPlane("wall", 1, (-1.0, 0.0), -1.0)]
    while len(barriers) < ROWS:
        k = len(barriers)
        angle, radius = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.5, 2.0)
        distance = radius + rng.uniform(-0.2, 1.0)
        center = (float(distance * np.cos(angle)), float(distance * np.sin(angle)))
        barriers.append(Disc(f"disc {k}", min(1 + k % 4, k + 1), center, radius))
    return tuple(barriers)


@functools.cache
def states(count: int) -> tuple[BarrierSet, Array, Array, Array]:
    """Return scenes, states (N, 4), times (N,) and nominal inputs (N, 2)."""
    rng = np.random.default_rng(0)
    barriers = BarrierSet([scene(rng) for _ in range(count)])
    x = np.concatenate((rng.normal(0.0, 0.2, (count, 2)), rng.normal(0.0, 0.5, (count, 2))), axis=1)
    return barriers, x, np.zeros(count), rng.normal(0.0, 3.0, (count, 2))


def medians(calls: Iterable[Callable[[], Any]], repeats: int) -> list[float]:
    """Return each call's median time [µs]."""
    return in_turn([(nothing, call) for call in calls], repeats).tolist()


def _filter_in_turn(name: str) -> Callable[[], Any]:
    """Return a call that filters the next of 64 states, rows included."""
    _, x, t, u = states(64)
    scenes = [BarrierSet([scene(np.random.default_rng(i))]) for i in range(64)]
    cases = [(scenes[i], x[i : i + 1], t[:1], u[i]) for i in range(64)]
    program, settings = programs.make(name), RowSettings()
    turn = iter(range(10**9))

    def call() -> None:
        barriers, x, t, u = cases[next(turn) % len(cases)]
        a, b, h, priority, alpha2_psi = planar_rows(barriers, x, t, settings)
        assert alpha2_psi is not None
        program(u, CbfRows(a[0], b[0], h[0], priority[0], alpha2_psi[0]))

    return call


def _single(repeats: int) -> dict[str, float]:
    times = medians(map(_filter_in_turn, programs.names()), repeats)
    return dict(zip(programs.names(), times, strict=True))


def _filter_batch(name: str, size: int) -> Callable[[], Any]:
    barriers, x, t, u = states(size)
    batch, settings = programs.make_batch(name), RowSettings()
    return lambda: batch(u, planar_rows(barriers, x, t, settings))


def _batch(repeats: int, size: int) -> dict[str, float]:
    names = programs.names()
    times = medians([_filter_batch(name, size) for name in names], repeats)
    return {name: time / size for name, time in zip(names, times, strict=True)}


def _peers(repeats: int) -> dict[str, float]:
    """Return the times of cbfpy's filter and of our own programs, in turn."""
    if importlib.util.find_spec("cbfpy") is None:
        return {}
    from benchmarks import peers

    ours = ("lex-cbf-qp", "h-cbf-qp", "eh-cbf-qp")
    calls = [peers.cbfpy_filter(), *(_filter_in_turn(name) for name in ours)]
    return dict(zip(("cbfpy safety_filter", *ours), medians(calls, repeats), strict=True))


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the programs' times, and those beside cbfpy's."""
    columns = {
        "program": "`{name}`", "single [µs]": "{single:.0f}", "batch [µs]": "{batch:.2f}",
        "actions/s": "{actions_per_second:,.0f}", "gain": "{batch_gain:.0f}",
    }  # fmt: skip
    keys = ("single", "batch", "actions_per_second", "batch_gain")
    programs = [
        {"name": name} | {key: figures[key][name] for key in keys} for name in figures["single"]
    ]
    of_peers = {"filter": "{name}", "a filtered action": "{time:.1f}"}
    peers = [{"name": name, "time": time} for name, time in figures["peers"].items()]
    return {
        "programs": table("A filtered action, 4 rows, rows included: medians", programs, columns),
        "peers": table("In turn with peers [µs]", peers, of_peers),
    }
