"""Every program against its solution in rational arithmetic, on random problems of every kind."""

import functools
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from benchmarks.common import table
from benchmarks.judges.judge import Judge
from hcbf_gym import programs
from hcbf_gym.arrays import Array
from hcbf_gym.evaluation.jobs import Runs
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.models.input_sets import Ball, Box, InputSet
from hcbf_gym.programs import CbfRows, FilterResult, FilterStatus

TOLERANCE = 1e-6  # Largest |Δu| that counts as the same input
GROUP = 100  # Problems that share a program with its options
INPUTS = {"batch": 2, "single": 2, "2 inputs": 2, "1 input": 1, "3 inputs": 3, "7 inputs": 7}
"""The forms that are compared, and their numbers of inputs: `make_batch` and `make`; "2 inputs" are
those by DAQP."""
FORMS = tuple(INPUTS)

INPUT_SETS: tuple[InputSet, ...] = (Box.symmetric(5.0), Box([-1.0, 0.0], [4.0, 2.5]), Ball(5.0))


@dataclass
class Tally:
    """What came out of the comparison of one program in one form."""

    problems: int = 0  # how many were compared
    largest_difference: float = 0.0  # the largest |Δu| among those that are not wrong
    wrong: int = 0  # how many differ by more than `TOLERANCE`
    backups: int = 0  # answers with status BACKUP
    fallbacks: int = 0  # problems with a stage that took twice the digits, or DAQP's second opinion

    def add(self, answer: FilterResult, wanted: Array) -> None:
        """Compare one answer with the exact input."""
        difference = float(np.abs(answer.u - wanted).max())
        self.problems += 1
        self.backups += int(answer.status == FilterStatus.BACKUP)
        self.fallbacks += int(answer.fallbacks > 0)
        if difference <= TOLERANCE:
            self.largest_difference = max(self.largest_difference, difference)
        else:
            self.wrong += 1

    def __add__(self, other: "Tally") -> "Tally":
        """Return the tally of both."""
        both = {
            field.name: getattr(self, field.name) + getattr(other, field.name)
            for field in fields(self)
        }
        both["largest_difference"] = max(self.largest_difference, other.largest_difference)
        return Tally(**both)


def random_rows(rng: np.random.Generator, count: int, m: int, n_u: int = 2) -> CbfRows:
    """Return m rows for each of `count` states, a share of them degenerate.

    Beside plain ones there are rows with gradients down to 1e-9, zero rows, and copies of an
    earlier row, scaled by a power of two (so that they are parallel exactly), with the same or the
    opposite sign, and with the same bound or another.
    """
    direction = rng.normal(0.0, 1.0, (count, m, n_u))
    length = rng.lognormal(0.0, 0.7, (count, m))
    a = direction * (length / np.linalg.norm(direction, axis=-1))[..., None]
    b = (
        length
        * rng.normal(0.0, 4.0, (count, m))
        * rng.choice([1.0, 10.0], (count, m), p=[0.9, 0.1])
    )
    kind = rng.choice(5, (count, m), p=[0.6, 0.12, 0.05, 0.15, 0.08])
    faint = (kind == 1) * 10.0 ** rng.uniform(-9.0, -2.0, (count, m)) + (kind != 1)
    a *= faint[..., None]
    b *= np.where(rng.random((count, m)) < 0.7, faint, 1.0)
    a[kind == 2] = 0.0
    for k in range(1, m):
        source = rng.integers(0, k, count)
        factor = 2.0 ** rng.integers(-2, 3, count) * rng.choice([-1.0, 1.0], count)
        copied, same = kind[:, k] >= 3, kind[:, k] == 4
        index = np.arange(count)
        a[:, k] = np.where(copied[:, None], factor[:, None] * a[index, source], a[:, k])
        b[:, k] = np.where(same, factor * b[index, source], b[:, k])
    levels = rng.integers(1, m + 1, (count, 1))
    drawn = rng.integers(0, levels, (count, m))
    priority = np.stack([np.unique(p, return_inverse=True)[1] for p in drawn]) + 1
    return CbfRows(
        a, b, rng.normal(0.0, 1.0, (count, m)), priority, rng.normal(0.0, 2.0, (count, m))
    )


def random_nominal(rng: np.random.Generator, count: int, input_set: InputSet) -> np.ndarray:
    """Return nominal inputs inside U, on its border, at its corners and far outside."""
    u = rng.normal(0.0, 3.0, (count, input_set.n_u)) * rng.choice(
        [1.0, 30.0], (count, 1), p=[0.8, 0.2]
    )
    vertices = input_set.vertices()
    corner = vertices[rng.integers(0, len(vertices), count)]
    border = np.stack([input_set.project(point) for point in 10.0 * u])
    kind = rng.choice(3, (count, 1), p=[0.7, 0.2, 0.1])
    return np.where(kind == 0, u, np.where(kind == 1, border, corner))


def random_options(rng: np.random.Generator, name: str) -> dict[str, Any]:
    """Return options of a program, weights from 0 to 1e6 among them."""

    def weight() -> float:
        return float(rng.choice([0.0, 5.0, 10.0 ** rng.uniform(-3.0, 6.0)], p=[0.1, 0.3, 0.6]))

    every = {
        "gamma0": [weight() for _ in range(rng.integers(1, 4))],
        "delta_gamma": float(rng.choice([0.0, 1.3])),
        "lambda_u": float(rng.choice([0.0, 1.0, 10.0 ** rng.uniform(-2.0, 2.0)])),
        "epsilon": str(rng.choice(["zero", "known"])),
        "weights": [None, *[None if rng.random() < 0.6 else weight() for _ in range(3)]],
    }
    return {key: value for key, value in every.items() if key in programs.options(name)}


def verify_group(
    name: str, seed: list[int], forms: Sequence[str] = FORMS, size: int = GROUP
) -> dict[str, Tally]:
    """Compare the forms of a program with its exact solution on `size` problems."""
    tallies = {form: Tally() for form in forms}
    for n_u in sorted({INPUTS[form] for form in forms}):
        rng = np.random.default_rng([programs.names().index(name), *seed, n_u])
        input_set = _input_set(rng, n_u)
        options = random_options(rng, name)
        rows = random_rows(rng, size, int(rng.integers(1, 9)), n_u)
        u_nominal = random_nominal(rng, size, input_set)
        exact = None
        for form in forms:
            if INPUTS[form] != n_u:
                continue
            if exact is None:
                exact = _exact(name, input_set, u_nominal, rows, options)
            answers = _answers(form, name, input_set, u_nominal, rows, options)
            for answer, wanted in zip(answers, exact, strict=True):
                tallies[form].add(answer, wanted)
    return tallies


def _input_set(rng: np.random.Generator, n_u: int) -> InputSet:
    if n_u == 2:
        return INPUT_SETS[rng.integers(len(INPUT_SETS))]
    lopsided = Box(-rng.uniform(0.5, 2.0, n_u), rng.uniform(1.0, 5.0, n_u))
    return lopsided if rng.random() < 0.5 else Box.symmetric(5.0, n_u=n_u)


def _one(rows: CbfRows, i: int) -> CbfRows:
    return CbfRows(*(field[i] for field in rows if field is not None))


def _exact(
    name: str, input_set: InputSet, u_nominal: Array, rows: CbfRows, options: dict[str, Any]
) -> list[Array]:
    program = programs.make(name, input_set=input_set, **options)
    return [
        np.array(Judge.of(input_set, u, _one(rows, i), program).solve(name), dtype=np.float64)
        for i, u in enumerate(u_nominal)
    ]


def _answers(
    form: str,
    name: str,
    input_set: InputSet,
    u_nominal: Array,
    rows: CbfRows,
    options: dict[str, Any],
) -> list[FilterResult]:
    if form == "batch":
        together = programs.make_batch(name, input_set=input_set, **options)(u_nominal, rows)
        return [FilterResult(*(field[i] for field in together)) for i in range(len(u_nominal))]
    solver = "daqp" if form == "2 inputs" else None
    program = programs.make(name, input_set=input_set, solver=solver, **options)
    return [program(u, _one(rows, i)) for i, u in enumerate(u_nominal)]


def run(quick: bool) -> dict[str, Any]:
    """Verify every program and return the tallies.

    Two inputs on 100,000 problems (40 if quick), one, three and seven on 20,000 (20).
    """
    figures: dict[str, Any] = {name: {} for name in programs.names()}
    planar, general = ("batch", "single"), ("1 input", "3 inputs", "7 inputs")
    size = 20 if quick else GROUP
    for forms, count in ((planar, 40 if quick else 100_000), (general, 20 if quick else 20_000)):
        for name in programs.names():
            group = functools.partial(verify_group, name, forms=forms, size=size)
            seeds = [[0, k] for k in range(count // size)]
            for _, tallies in Runs().over(group, seeds, f"{name}, {forms[0]}"):
                for form, tally in tallies.items():
                    figures[name][form] = figures[name].get(form, Tally()) + tally
    return {
        name: {form: asdict(tally) for form, tally in tallies.items()}
        for name, tallies in figures.items()
    }


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the tallies of every program in every form."""
    rows = [
        {"program": name, "form": form} | tally
        for name, forms in figures.items()
        for form, tally in forms.items()
    ]
    columns = {
        "program": "`{program}`", "form": "{form}", "problems": "{problems:,}",
        "max |Δu|": "{largest_difference:.1e}", "wrong": "{wrong:,}", "BACKUP": "{backups:,}",
        "fallbacks": "{fallbacks:,}",
    }  # fmt: skip
    return {"all": table("Against rational arithmetic", rows, columns)}
