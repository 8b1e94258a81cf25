"""Every program against its solution in rational arithmetic, on random problems of every kind."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from typing import Any

import joblib
import numpy as np
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeElapsedColumn
from rich.table import Table

from hcbf_gym import programs
from hcbf_gym.models.input_sets import Ball, Box, InputSet
from hcbf_gym.programs import CbfRows, FilterResult, FilterStatus
from hcbf_gym.programs.exact.rational import Polygon, rational
from hcbf_gym.studies.benchmarks.exact import Exact, gap, nearest

TOLERANCE = 1e-6
"""Largest |Δu| that counts as the same input."""
COST_TOLERANCE = 1e-9
"""Largest relative excess of a stage's cost where inputs differ by more."""
GROUP = 100
"""Problems that share a program with its options."""

INPUT_SETS: tuple[InputSet, ...] = (
    Box.symmetric(5.0),
    Box([-1.0, 0.0], [4.0, 2.5]),
    Ball(5.0),
)


@dataclass
class Tally:
    """What came out of the comparison of one program in one form.

    Attributes:
        problems: how many were compared.
        largest_difference: |Δu| of those with the same input to `TOLERANCE`.
        equal_cost: other inputs, for which the first stage that differs by more than
            `COST_TOLERANCE`, if any, costs less.
        wrong: all others.
        backups: answers with status BACKUP.
        fallbacks: problems with a stage that the second solver or rational arithmetic answered.
    """

    problems: int = 0
    largest_difference: float = 0.0
    equal_cost: int = 0
    wrong: int = 0
    backups: int = 0
    fallbacks: int = 0

    def __add__(self, other: "Tally") -> "Tally":
        """Return the tally of both."""
        both = {
            field.name: getattr(self, field.name) + getattr(other, field.name)
            for field in fields(self)
        }
        both["largest_difference"] = max(self.largest_difference, other.largest_difference)
        return Tally(**both)


def random_rows(rng: np.random.Generator, count: int, m: int) -> CbfRows:
    """Return m rows for each of `count` states, a share of them degenerate.

    Beside plain ones there are rows with gradients down to 1e-9, zero rows, and copies of an
    earlier row, scaled by a power of two (so that they are parallel exactly), with the same or the
    opposite sign, and with the same bound or another.
    """
    angle = rng.uniform(0.0, 2.0 * np.pi, (count, m))
    length = rng.lognormal(0.0, 0.7, (count, m))
    a = length[..., None] * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
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
    u = rng.normal(0.0, 3.0, (count, 2)) * rng.choice([1.0, 30.0], (count, 1), p=[0.8, 0.2])
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


def verify(name: str, samples: int, seed: int = 0, jobs: int = 1) -> Iterator[dict[str, Tally]]:
    """Compare both forms of a program with its exact solution; yield the tallies as they grow.

    Args:
        name: the program.
        samples: how many problems, rounded up to whole groups.
        seed: decides all of them.
        jobs: how many processes share the work; −1 is one for each core.

    Yields:
        The tallies of "batch" and "single", after each group of problems.
    """
    groups = range(-(-samples // GROUP))
    work = (joblib.delayed(verify_group)(name, [seed, group]) for group in groups)
    total = {"batch": Tally(), "single": Tally()}
    done: Any = joblib.Parallel(jobs, return_as="generator")(work)
    for tallies in done:
        total = {form: total[form] + tally for form, tally in tallies.items()}
        yield total


def verify_group(name: str, seed: list[int]) -> dict[str, Tally]:
    """Compare a program, under options of the group's own, on `GROUP` problems."""
    rng = np.random.default_rng([programs.names().index(name), *seed])
    input_set = INPUT_SETS[rng.integers(len(INPUT_SETS))]
    options = random_options(rng, name)
    batch = programs.make_batch(name, input_set=input_set, **options)
    one = programs.make(name, input_set=input_set, **options)
    rows = random_rows(rng, GROUP, int(rng.integers(1, 9)))
    u_nominal = random_nominal(rng, GROUP, input_set)
    together = batch(u_nominal, rows)
    tallies = {"batch": Tally(), "single": Tally()}
    for i in range(GROUP):
        row = CbfRows(*(field[i] for field in rows if field is not None))
        problem = Exact.of(
            input_set.vertices(), u_nominal[i], row,
            one.cascade.weights.of(row.priority, row.h), one.cascade.least_slack(row),
            one.cascade.lambda_u,
        )  # fmt: skip
        choices = problem.choices(name)
        answer = FilterResult(*(field[i] for field in together))
        _judge(tallies["batch"], name, problem, choices, answer)
        _judge(tallies["single"], name, problem, choices, one(u_nominal[i], row))
    return tallies


def _judge(tally: Tally, name: str, problem: Exact, choices: Polygon, answer: FilterResult) -> None:
    u = answer.u
    tally.problems += 1
    tally.backups += int(answer.status == FilterStatus.BACKUP)
    tally.fallbacks += int(answer.fallbacks > 0)
    exact = nearest(choices, problem.u_nominal)
    difference = max(abs(float(exact[0]) - u[0]), abs(float(exact[1]) - u[1]))
    if difference <= TOLERANCE:
        tally.largest_difference = max(tally.largest_difference, float(difference))
        return
    found = (rational(float(u[0])), rational(float(u[1])))
    got, least = problem.costs(name, found), problem.costs(name, exact)
    if len(choices) > 1:  # then the distance from u* decides
        got.append(gap(found, problem.u_nominal))
        least.append(gap(exact, problem.u_nominal))
    excess = [float((x - y) / (1 + y)) for x, y in zip(got, least, strict=True)]
    # the first stage that differs decides, as it does in the programs
    first = next((k for k, x in enumerate(excess) if abs(x) > COST_TOLERANCE), None)
    if first is None or excess[first] < 0.0:
        tally.equal_cost += 1
    else:
        tally.wrong += 1


def run(quick: bool) -> dict[str, Any]:
    """Verify every program on 100,000 problems (2,000 if quick), print and return the tallies."""
    samples = 2_000 if quick else 100_000
    table = Table(title=f"{samples:,} problems for each program, against rational arithmetic")
    for header in ("program", "form", "max |Δu|", "equal cost", "wrong"):
        table.add_column(header, justify="right")
    for header in ("backups", "second solver or rational"):
        table.add_column(header, justify="right")
    figures: dict[str, Any] = {}
    columns = (*Progress.get_default_columns(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        for name in programs.names():
            bar = progress.add_task(name, total=samples)
            for tallies in verify(name, samples, jobs=-1):
                progress.update(bar, completed=tallies["batch"].problems)
                figures[name] = {form: asdict(tally) for form, tally in tallies.items()}
            for form, tally in figures[name].items():
                cells = [f"{tally['largest_difference']:.1e}"]
                keys = ("equal_cost", "wrong", "backups", "fallbacks")
                table.add_row(name, form, *cells, *(str(tally[key]) for key in keys))
    Console().print(table)
    return figures
