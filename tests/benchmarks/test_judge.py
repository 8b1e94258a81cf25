"""The judge of the programs: what it calls proven is a minimiser, in rational numbers."""

import numpy as np
import pytest

from benchmarks.judges import certificate
from benchmarks.judges.certificate import FREE, KINK, PAID, Stage, dot
from benchmarks.judges.exact import exactly, rational
from benchmarks.suites.verify_programs import random_nominal, random_rows
from hcbf_gym.models.input_sets import Box


def stages(seed, count):
    """Yield stages with degenerate rows, flat ones, and hard rows that meet in one point."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        n = int(rng.choice([1, 2, 3]))
        box = Box.symmetric(5.0, n_u=n)
        rows = random_rows(rng, 1, int(rng.integers(1, 7)), n)
        a, b = box.halfspaces()
        bounds = exactly(b).tolist()
        u = random_nominal(rng, 2, box)
        if rng.random() < 0.5:  # as a stage before leaves it: rows bound at a point of the box
            point = exactly(np.clip(u[1], -5.0, 5.0)).tolist()
            a, bounds = np.vstack((a, rows.a[0])), bounds + [dot(k, point) for k in rows.a[0]]
        lambda_u = float(rng.choice([0.0, 1.0, 50.0]))
        weight = 10.0 ** rng.uniform(-3.0, 6.0, rows.b.size)
        least = np.maximum(0.0, rng.normal(0.0, 1.0, rows.b.size))
        for kind in (None, 0.0 * least, least):
            target = exactly(rows.b[0]).tolist()
            yield Stage(
                a, bounds, np.full(n, -6.0), u[0], lambda_u, rows.a[0], target, weight, kind
            )


def cost(stage, u):
    """Return the cost of a stage at u, exactly."""
    total = rational(0)
    for x, y in zip(u, exactly(stage.u_nominal), strict=True):
        total += rational(stage.lambda_u) * (x - y) ** 2
    for k, (a, t, w) in enumerate(zip(stage.soft, stage.target, stage.weight, strict=True)):
        violation = t - dot(a, u)
        if stage.least is not None:
            violation = max(rational(float(stage.least[k])), violation)
        total += rational(float(w)) * violation**2
    return total


def feasible(stage, u):
    return all(dot(a, u) >= b for a, b in zip(stage.hard, stage.bound, strict=True))


def test_what_is_proven_costs_what_rational_pivots_find():
    for stage in stages(0, 60):
        u = certificate.minimiser(stage)
        assert feasible(stage, u)
        assert cost(stage, u) == cost(stage, certificate.by_pivots(stage))


def test_no_wrong_guess_is_proven():
    rng = np.random.default_rng(1)
    proven = 0
    for stage in stages(2, 60):
        tight = rng.random(len(stage.bound)) < 0.15
        choices = [PAID] if stage.least is None else [FREE, PAID, KINK]
        u = certificate.proven(stage, tight, rng.choice(choices, len(stage.target)))
        if u is None:
            continue
        proven += 1
        assert feasible(stage, u)
        assert cost(stage, u) == cost(stage, certificate.by_pivots(stage))
    assert proven > 20


@pytest.mark.parametrize("size", [1, 2, 5])
def test_equations_are_solved_exactly(size):
    rng = np.random.default_rng(size)
    a, x = rng.normal(0.0, 1.0, (size, size)), exactly(rng.normal(0.0, 1.0, size)).tolist()
    a[0] *= 1e-9
    equations = [[*exactly(row).tolist(), dot(row, x)] for row in a]
    assert certificate.solve(equations) == x
    assert certificate.solve([*equations[1:], equations[-1]]) is None or size == 1
