"""The gatekeeper under attack: hostile inputs, estimates that err within their bounds, all shapes.

`python -m benchmarks.gatekeeper` takes a million steps, and looks at the truth between the samples.
"""

import argparse
import json
import time
from collections import Counter
from typing import Any, NamedTuple

import numpy as np

import hcbf_gym
from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import (
    Barrier,
    BarrierSet,
    Capsule,
    ConvexPolygon,
    Disc,
    Ellipse,
    HalfPlane,
    SpeedLimit,
)
from hcbf_gym.models.input_sets import Ball, Box
from hcbf_gym.models.plant import Estimate, Uncertainty
from hcbf_gym.programs import FilterStatus

LOOKS = 16
"""Times within a period at which the truth is looked at."""
ENTERED, OF_ROWS = -1e-9, -1e-4
"""h below which a region counts as entered [m]: rounding, and what rows may lack of a proof."""
CONFIDENCE = 3.0


class Case(NamedTuple):
    """What of an attack is drawn for N plants together.

    Attributes:
        period: T [s].
        input_set: U.
        position: by how much a position errs at most [m].
        velocity: by how much a velocity errs at most [m/s].
        covaries: whether that is the estimate's covariance, or the plant's uncertainty.
    """

    period: float
    input_set: Box | Ball
    position: float
    velocity: float
    covaries: bool

    def filter(self, count: int, **others: Any) -> hcbf_gym.BatchFilter:
        """Return the filter of N plants that knows these bounds."""
        known = Uncertainty(confidence=CONFIDENCE)
        if not self.covaries:
            known = known._replace(distance=self.position, speed=self.velocity)
        return hcbf_gym.BatchFilter(
            self.input_set, self.period, count, strict="gatekeeper", uncertainty=known, **others
        )

    def estimate(self, x: Array, t: Array, error: Array) -> Estimate:
        """Return estimates of the states x (N, 4) with errors of at most size 1 (N, 4)."""
        sizes = np.repeat([self.position, self.velocity], 2)
        if not self.covaries:
            return Estimate(x + sizes * error, t)
        covariance = np.diag((sizes / CONFIDENCE) ** 2)
        return Estimate(x + sizes * error, t, np.tile(covariance, (len(x), 1, 1)))


def draw(rng: np.random.Generator) -> Case:
    """Return a case: a third of them without errors."""
    period = float(rng.choice([0.01, 0.02, 0.05, 0.1]))
    size = rng.uniform(2.0, 6.0)
    shape = int(rng.integers(3))
    box = Box(-size * rng.uniform(0.5, 1.0, 2), size * rng.uniform(0.5, 1.0, 2))
    input_set = Ball(size, int(rng.choice([3, 5, 16]))) if shape == 0 else box
    errs = float(rng.choice([0.0, 1.0, 1.0]))
    position, velocity = errs * 10.0 ** rng.uniform(-3.0, -1.3, 2)
    return Case(period, input_set, position, velocity, bool(rng.integers(2)))


def scene(rng: np.random.Generator) -> tuple[Barrier, ...]:
    """Return six regions of ranks 1 and 2 around the origin, and mostly a speed limit."""
    found: list[Barrier] = []
    for i in range(6):
        turn = rng.uniform(0.0, 2.0 * np.pi)
        center: Any = rng.uniform(1.2, 4.0) * np.array([np.cos(turn), np.sin(turn)])
        moves: Any = rng.uniform(-1.0, 1.0, 2) * rng.choice([0.0, 0.3, 1.0, 1.5])
        rank, size, kind = int(rng.choice([1, 1, 2])), rng.uniform(0.1, 0.6), int(rng.integers(5))
        if kind == 0:
            normal: Any = -center / np.linalg.norm(center)
            found.append(HalfPlane(f"{i}", rank, normal, normal @ center * 1.5))
        elif kind == 1:
            found.append(Disc(f"{i}", rank, center, size, velocity=moves))
        elif kind == 2:
            axes: Any = size * np.array([1.0, rng.uniform(0.2, 1.0)])
            found.append(Ellipse(f"{i}", rank, center, axes, turn, velocity=moves))
        elif kind == 3:
            end: Any = center + rng.uniform(0.2, 1.0, 2)
            found.append(Capsule(f"{i}", rank, center, end, size, velocity=moves))
        else:
            corner = int(rng.integers(3, 8))
            at = turn + 2.0 * np.pi * (np.arange(corner) + rng.uniform(0.0, 0.5, corner)) / corner
            corners: Any = center + size * np.column_stack([np.cos(at), np.sin(at)])
            found.append(ConvexPolygon(f"{i}", rank, corners, velocity=moves))
    if rng.uniform() < 0.7:
        found.append(SpeedLimit("limit", 1, float(rng.uniform(1.0, 2.5))))
    return tuple(found)


def hostile(rng: np.random.Generator, u: Array, step: int, seen: Array, radius: float) -> Array:
    """Return u* (N, 2): a fourth each presses, slides to and fro, is random and stays so.

    Args:
        rng: of the random ones.
        u: (N, 2) the last u*.
        step: of the episode.
        seen: (N, m, 4) h, unit gradient and rate of the conditions.
        radius: the largest input.
    """
    count = len(u)
    nearest = np.where(seen[..., 1:3].any(axis=2), seen[..., 0], np.inf).argmin(axis=1)
    n = seen[np.arange(count), nearest, 1:3]
    side = np.column_stack([-n[:, 1], n[:, 0]]) * np.sign(np.sin(0.3 * step))
    found = np.where(rng.uniform(size=(count, 1)) < 0.1, rng.normal(size=(count, 2)), u)
    found[::4], found[1::4] = -n[::4], side[1::4] - n[1::4]
    found[2::4] = rng.normal(size=found[2::4].shape)
    return radius * found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9)


def errors(rng: np.random.Generator, seen: Array) -> Array:
    """Return errors (N, 4) of size 1: half of them away from the nearest region."""
    count = len(seen)
    error = rng.normal(size=(count, 2, 2))
    nearest = np.where(seen[..., 1:3].any(axis=2), seen[..., 0], np.inf).argmin(axis=1)
    error[::2] = seen[np.arange(count), nearest, None, 1:3][::2]
    error /= np.maximum(np.linalg.norm(error, axis=2, keepdims=True), 1e-9)
    return (error * rng.choice([0.0, 1.0, 1.0], (count, 2, 1))).reshape(count, 4)


def episode(rng: np.random.Generator, count: int, steps: int) -> tuple[Counter[str], float]:
    """Return what happened in N episodes of one case, and the least h of a calm step [m]."""
    case = draw(rng)
    scenes = BarrierSet([scene(rng) for _ in range(count)], is_placed=True)
    strict = (scenes.priority == 1) & scenes.is_region
    lower = (scenes.priority == 2) & scenes.is_region
    filt = case.filter(count)
    filt.set_scene(scenes)  # pyright: ignore[reportArgumentType]
    x, t, u = np.zeros((count, 4)), np.zeros(count), np.zeros((count, 2))
    happened: Counter[str] = Counter()
    least = np.inf
    filt.reset(x=case.estimate(x, t, np.zeros((count, 4))))
    for step in range(steps):
        _, seen = scenes.sense(x, t)
        u = hostile(rng, u, step, seen, case.input_set.radius)
        chosen, report = filt(u, case.estimate(x, t, errors(rng, seen)), t)
        calm = report["status"] <= FilterStatus.RELAXED
        keeps = np.full((2, count), np.inf)
        for tau in np.linspace(0.0, case.period, LOOKS):
            p = x[:, :2] + (x[:, 2:] + 0.5 * chosen * tau) * tau
            h = scenes.values(np.hstack([p, x[:, 2:] + chosen * tau]), t + tau)
            for least_h, which in zip(keeps, (strict, lower), strict=True):
                np.minimum(least_h, np.where(which, h, np.inf).min(axis=1), out=least_h)
        happened["steps"] += count
        happened["calm"] += int(calm.sum())
        happened["changed"] += int((report["status"][calm] > FilterStatus.NOMINAL).sum())
        happened["unverified"] += int((report["reason"] == Reason.UNVERIFIED).sum())
        alarms = (report["reason"] > 0) & (report["reason"] != Reason.UNVERIFIED)
        happened["alarms"] += int(alarms.sum())
        entered = keeps[0] < np.where(report["verified"] > 0, ENTERED, OF_ROWS)
        happened["entered while calm"] += int((calm & entered).sum())
        happened["entered while not calm"] += int((~calm & entered).sum())
        both = calm & (report["verified"] >= 2)
        happened["rank 2 entered while verified"] += int((both & (keeps[1] < ENTERED)).sum())
        least = min(least, float(keeps[0][calm].min(initial=np.inf)))
        x[:, :2] += (x[:, 2:] + 0.5 * chosen * case.period) * case.period
        x[:, 2:] += chosen * case.period
        t += case.period
    return happened, least


def main() -> None:
    """Attack, and print what happened."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    rng, began = np.random.default_rng(asked.seed), time.perf_counter()
    happened, least = Counter[str](), np.inf
    while happened["steps"] < asked.steps:
        more, lowest = episode(rng, 100, 200)
        happened, least = happened + more, min(least, lowest)
    found = {name: happened[name] for name in sorted(happened)} | {"least h while calm": least}
    print(json.dumps(found | {"s": round(time.perf_counter() - began)}, indent=1))


if __name__ == "__main__":
    main()
