"""What `SafetyFilter` adds to a step in a user's loop, in turn with what cbfpy's filter adds to it.

Both have the same barriers and input set. For the ratio both have the same rows, too: linear α₁ and
α₂, as cbfpy has them by default, usual rows, no margin. Beside it stands what the filter adds as it
is shipped, with the paper's logarithm and rows for a held input. All are pinned to one core and
take turns, so that they see the same machine, in loops around the same environment, so that what
the environment does to the caches is done to both. cbfpy is also called with nothing between,
where its code stays in the caches.
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks import peers
from benchmarks.common import Timed, in_turn, nothing, one_core, table
from hcbf_gym.barriers import Disc, HalfPlane, to_dict
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.wrappers import SafetyFilter

PROGRAMS = ("h-cbf-qp", "eh-cbf-qp", "lex-cbf-qp")
ROW_COUNTS = (2, 5, 12)
PLACES = {"idle": (-50.0, -50.0), "conflict": (0.0, 0.0)}
SAME_ROWS: dict[str, Any] = {"alpha1": 1.0, "alpha2": 1.0, "rows": "usual", "margin": 0.0}
REPETITIONS = 5
BLOCK = 25, 5  # calls of a block, and those of them that warm caches and XLA's threads
WANTED = np.array([0.5, 0.5])

SHAPES = (  # At the origin the first two require opposite inputs; far away nothing binds
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
    blocks = 2 if quick else 40
    with one_core():
        rows = [row for n in ROW_COUNTS for place in PLACES for row in _rows(n, place, blocks)]
    return {"cbfpy": peers.settings(), "same_rows": SAME_ROWS, "filter": rows}


def _rows(count: int, place: str, blocks: int) -> list[dict[str, Any]]:
    """Return the figures of one scene at one place, a program each."""
    scene = {
        "name": f"{count} rows",
        "barriers": [to_dict(shape) for shape in SHAPES[:count]],
        "reference": {"kind": "point", "goal": [3.0, 3.0]},
        "start": list(PLACES[place]),
    }
    x = np.array([*PLACES[place], 0.0, 0.0])
    peer = peers.cbfpy_filter(SHAPES[:count], x, WANTED)
    calls = [
        _step(_environment(scene)),
        _step(_environment(scene), peer),
        *(_step(SafetyFilter(_environment(scene), name, **SAME_ROWS)) for name in PROGRAMS),
        *(_step(SafetyFilter(_environment(scene), name)) for name in PROGRAMS),
    ]
    times = np.array([in_turn(calls, blocks, *BLOCK) for _ in range(REPETITIONS)])
    cbfpy, added = times[:, 1:2] - times[:, :1], times[:, 2:] - times[:, :1]
    medians, ratios = np.median(added, axis=0), np.median(added / cbfpy, axis=0)
    alone = np.median([in_turn([(nothing, peer)], blocks, *BLOCK) for _ in range(REPETITIONS)])
    return [
        {
            "program": name,
            "rows": count,
            "place": place,
            "step": float(np.median(times[:, 0])),
            "cbfpy": float(np.median(cbfpy)),
            "alone": float(alone),
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


def _step(env: gym.Env[Any, Any], u: Callable[[], Any] | None = None) -> Timed:
    """Return how an episode begins, and its next step, under a peer's input if there is one."""
    action = WANTED.astype(np.float32)
    step = (lambda: env.step(action)) if u is None else lambda: env.step(u())
    return lambda: env.reset(seed=0), step


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the table of what each program adds."""
    versions = figures["cbfpy"]["versions"]
    columns = {
        "program": "`{program}`", "rows": "{rows}", "where": "{place}",
        "cbfpy alone [µs]": "{alone:.1f}", "cbfpy adds [µs]": "{cbfpy:.1f}",
        "SafetyFilter adds [µs]": "{added:.1f}",
        "share of that": "{ratio:.2f}", "as shipped [µs]": "{shipped:.1f}",
        "share of that ": "{shipped_ratio:.2f}",
    }  # fmt: skip
    title = (
        f"what SafetyFilter and cbfpy add to a step, in turn: cbfpy {versions['cbfpy']} "
        f"with ElastiQP {versions['elastiqp']}"
    )
    added = table(title, figures["filter"], columns)
    return {"added": added._replace(header=[name.rstrip() for name in added.header])}
