"""A search for counterexamples to the lemmas of `docs/rows.md`, under exactly what they assume.

Each claim is a function from numbers in [0, 1] to slacks, NaN where its assumptions do not hold.
Random numbers are drawn, and the worst of them moved by shrinking steps. Rows and distances are the
package's compiled ones; motion stands here once more.
"""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.refuting import held, speeds, stops
from benchmarks.refuting.cases import NUMBERS, Array, Case, draw

WORST = 60
ROUNDING = 1e-9
CORRECTED = ("6 within the rounding", "7 no more than a stop", "13 stop, usual")
"""What was refuted, and left the page."""

CLAIMS: dict[str, Callable[[Case, Array], Array]] = {
    "1 tangent": held.lemma_1,
    "2 between samples": held.lemma_2,
    "2 without the rounding": held.lemma_2_literal,
    "3 turn": held.lemma_3,
    "4 loss": held.lemma_4,
    "5 going round": held.lemma_5,
    "6 next sample": held.lemma_6,
    "6 within the rounding": held.lemma_6_nearer,
    "7 speed limit": speeds.lemma_7,
    "7 no more than a stop": speeds.a_stop,
    "8 U can brake": stops.lemma_8,
    "8 held bound": stops.held_bound,
    "9 braking at -5v": stops.braking,
    "9 straight braking": stops.lemma_9,
    "10 horizon": stops.lemma_10,
    "11 two pieces": held.lemma_11,
    "12 speed zones": speeds.lemma_12,
    "13 stop, held": stops.lemma_13,
    "13 stop, usual": stops.lemma_13_usual,
    "margin of an estimate": stops.growth,
}


def search(name: str, cases: int, count: int = 400, steps: int = 12) -> tuple[int, float, Any]:
    """Return how many samples met the assumptions, the worst slack and its case."""
    rng, looked, worst, where = np.random.default_rng(list(name.encode())), 0, np.inf, None
    for _ in range(cases):
        case = draw(rng, "polygon" if name.startswith("11") else "")
        z, width = rng.random((count, NUMBERS)), 0.3
        slack = np.full(count, np.inf)
        for step in range(steps):
            if step:
                best = z[np.argsort(slack)[: WORST // 4]]
                z = best[rng.integers(0, len(best), count)]
                moves = rng.normal(0.0, width, z.shape) * (rng.random(z.shape) < 0.4)
                z, width = np.clip(z + moves, 0.0, 1.0 - 1e-12), 0.6 * width
                z[: len(best)] = best
            with np.errstate(all="ignore"):
                found = CLAIMS[name](case, z)
            looked += int(np.isfinite(found).sum())
            slack = np.where(np.isfinite(found), found, np.inf)
            if slack.min() < worst:
                worst, where = float(slack.min()), (case, z[slack.argmin()])
    return looked, worst, where


def main(quick: bool) -> dict[str, float]:
    """Print what was searched, and return the worst slack of each claim."""
    out = {}
    print(f"{'claim':<26}{'samples':>12}{'worst slack':>14}  refuted")
    for name in CLAIMS:
        looked, out[name], _ = search(name, *((4, 100, 4) if quick else (30, 300, 12)))
        refuted = "yes" if out[name] < -ROUNDING else "no"
        refuted += ", and the page corrected" if name in CORRECTED else ""
        print(f"{name:<26}{looked:>12,}{out[name]:>14.2e}  {refuted}")
    return out


if __name__ == "__main__":
    main("--quick" in sys.argv)
