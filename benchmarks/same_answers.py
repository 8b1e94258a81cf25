"""Whether the programs still give the answers that they once gave, state by state.

``python -m benchmarks.same_answers record FILE`` draws states, filters them with every program and
writes both to a file; ``compare FILE`` filters the same states again and lists what differs. The
file holds the rows themselves, so that only the programs are compared. To record the answers of
another commit, put a folder that holds its package alone before this one on ``PYTHONPATH``.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

from benchmarks.drawn_states import FAMILIES, GROUP, draw, pool_of_scenes
from hcbf_gym import programs
from hcbf_gym.models.input_sets import Ball, Box, InputSet
from hcbf_gym.programs import CbfRows, FilterResult

Array = NDArray[np.float64]

TOLERANCE = 1e-9
"""Largest difference of u, slack or δ that counts as the same answer; slack relative to 1 + |b|."""
GENERAL = 6
"""States of a group that QP solvers filter as well; they take a thousand times longer."""
SETS: tuple[InputSet, ...] = (Box.symmetric(5.0), Ball(5.0), Box([-1.0, 0.0], [4.0, 2.5]))
FIELDS = ("a", "b", "h", "priority", "alpha2_psi", "u_nominal")
ANSWERS = ("u", "slack", "delta", "status", "fallbacks")


@dataclass
class Record:
    """Draw states, filter them and write both to a file.

    Args:
        file: to write, an npz.
        states: how many.
        seed: what decides them.
    """

    file: tyro.conf.Positional[Path]
    states: int = 100_000
    seed: int = 0


@dataclass
class Compare:
    """Filter a file's states again, and count the answers that differ, by program and family.

    Args:
        file: what ``record`` wrote.
    """

    file: tyro.conf.Positional[Path]


def main(command: Record | Compare) -> int:
    """Run a command; return 1 if answers differ."""
    if isinstance(command, Record):
        record(command.file, command.states, command.seed)
        return 0
    return compare(command.file)


def record(file: Path, states: int, seed: int) -> None:
    """Draw states, filter them and write both to a file."""
    pool, stored = pool_of_scenes(), {}
    for group in range(-(-states // GROUP)):
        rng = np.random.default_rng([seed, group])
        drawn = draw(rng, FAMILIES[group % len(FAMILIES)], pool)
        stored |= {f"{group}/{name}": drawn[name] for name in FIELDS}
        for key, answer in answers(group, drawn):
            for name in ANSWERS:
                stored[f"{group}/{key}/{name}"] = np.asarray(getattr(answer, name))
    with file.open("wb") as out:
        np.savez(out, **stored, seed=np.array(seed))


def compare(file: Path) -> int:
    """Filter a file's states again and print what differs; return 1 if anything does."""
    counts: dict[str, Tally] = {}
    with np.load(file) as stored:
        group = 0
        while f"{group}/b" in stored:
            drawn = {name: stored[f"{group}/{name}"] for name in FIELDS}
            tally = counts.setdefault(FAMILIES[group % len(FAMILIES)], Tally())
            for key, answer in answers(group, drawn):
                old = {name: stored[f"{group}/{key}/{name}"] for name in ANSWERS}
                tally.add(key, old, answer, 1.0 + np.abs(drawn["b"][: len(old["u"])]))
            group += 1
    differ = sum(tally.differ for tally in counts.values())
    for family, tally in counts.items():
        print(f"{family}: {tally}")
    print(f"{differ} answers differ by more than {TOLERANCE:g} or in their status")
    return int(differ > 0)


@dataclass
class Tally:
    """How the answers to one family of states compare.

    Attributes:
        answers: how many were compared.
        differ: how many differ by more than `TOLERANCE` or in their status.
        given_up: how many fell back on rational arithmetic and now do not.
        largest: the largest differences of u, slack and δ.
        largest_given_up: the largest difference of u among those that were given up.
        where: the programs and forms with answers that differ, and how many each has.
    """

    answers: int = 0
    differ: int = 0
    given_up: int = 0
    largest: Array = field(default_factory=lambda: np.zeros(3))
    largest_given_up: float = 0.0
    where: dict[str, int] = field(default_factory=dict)

    def add(self, key: str, old: dict[str, Any], new: FilterResult, scale: Array) -> None:
        """Compare the answers that a form of a program gives to a group of states."""
        gaps = np.stack(
            (
                np.abs(new.u - old["u"]).max(axis=1),
                (np.abs(new.slack - old["slack"]) / scale).max(axis=1, initial=0.0),
                (np.abs(new.delta - old["delta"]) / scale).max(axis=1, initial=0.0),
            )
        )
        given_up = (old["fallbacks"] > 0) & (np.asarray(new.fallbacks) == 0)
        other = (np.asarray(new.status) != old["status"]) | ~(gaps.max(axis=0) <= TOLERANCE)
        self.answers += other.size
        self.differ += int(other.sum())
        self.given_up += int(given_up.sum())
        self.largest = np.maximum(self.largest, gaps.max(axis=1))
        self.largest_given_up = max(self.largest_given_up, gaps[0, given_up].max(initial=0.0))
        if other.any():
            self.where[key] = self.where.get(key, 0) + int(other.sum())

    def __str__(self) -> str:
        """Return the figures in a line."""
        sizes = ", ".join(f"{n} {gap:.1e}" for n, gap in zip("usδ", self.largest, strict=True))
        return (
            f"{self.answers} answers, {self.differ} differ {self.where or ''} (largest: {sizes}); "
            f"{self.given_up} no longer in rational arithmetic (largest: "
            f"u {self.largest_given_up:.1e})"
        )


# ------------------------------------------------------------------ answers


def answers(group: int, drawn: dict[str, Any]) -> Iterator[tuple[str, FilterResult]]:
    """Yield what each form of each program makes of a group's states."""
    rng = np.random.default_rng([7, group])
    rows = CbfRows(*(drawn[name] for name in FIELDS[:5]))
    u_nominal, input_set = drawn["u_nominal"], SETS[rng.integers(len(SETS))]
    own = rng.random() < 0.2
    for name in programs.names():
        options = _options(rng, name, own)
        batch = programs.make_batch(name, input_set=input_set, **options)
        yield f"{name} batch", batch(u_nominal, rows)
        make = lambda i, solver, o=options, n=name: programs.make(  # noqa: E731
            n, input_set=input_set, solver=solver, **_of_state(o, i)
        )
        for form, solver, count in (("single", None, GROUP), ("daqp", "daqp", GENERAL)):
            program, found = make(0, solver), []
            for i in range(count):
                program = make(i, solver) if own else program
                one = CbfRows(*(field[i] for field in rows if field is not None))
                found.append(program(u_nominal[i], one))
            yield f"{name} {form}", FilterResult(*(np.array(part) for part in zip(*found)))  # noqa: B905
        yield f"{name} 3 inputs", _with_three(name, rng, u_nominal, rows, _of_state(options, 0))


def _with_three(
    name: str, rng: np.random.Generator, u_nominal: Array, rows: CbfRows, options: dict[str, Any]
) -> FilterResult:
    """Filter states of three inputs: a third column beside the two of the gradients."""
    program, found = programs.make(name, input_set=Box.symmetric(5.0, n_u=3), **options), []
    for i in range(GENERAL):
        one = CbfRows(*(field[i] for field in rows if field is not None))
        third = np.linalg.norm(one.a, axis=1) * rng.normal(0.0, 0.7, one.b.size)
        one = one._replace(a=np.column_stack((one.a, third)))
        found.append(program(np.append(u_nominal[i], rng.normal(0.0, 3.0)), one))
    return FilterResult(*(np.array(part) for part in zip(*found, strict=True)))


def _options(rng: np.random.Generator, name: str, own: bool) -> dict[str, Any]:
    """Return options, weights from 0 to 1e6 among them; each state has its `own`, if any."""

    def weight() -> float:
        return float(rng.choice([0.0, 5.0, 10.0 ** rng.uniform(-3.0, 6.0)], p=[0.1, 0.3, 0.6]))

    every = {
        "gamma0": [weight() for _ in range(rng.integers(1, 4))],
        "delta_gamma": float(rng.choice([0.0, 1.3])),
        "lambda_u": float(rng.choice([0.0, 1.0, 10.0 ** rng.uniform(-2.0, 2.0)])),
        "epsilon": str(rng.choice(["zero", "known"])),
        "weights": [None, *[None if rng.random() < 0.6 else weight() for _ in range(3)]],
    }
    if own:
        every["gamma0"] = 10.0 ** rng.uniform(-2.0, 3.0, (GROUP, 2))
        every["delta_gamma"] = rng.uniform(0.0, 2.0, (GROUP, 1))
        if "weights" in programs.options(name):
            every["delta_gamma"] = 0.0
    return {key: value for key, value in every.items() if key in programs.options(name)}


def _of_state(options: dict[str, Any], i: int) -> dict[str, Any]:
    """Return the options of one state of a group."""
    own = {key: value for key, value in options.items() if isinstance(value, np.ndarray)}
    own = {key: value[i].tolist() for key, value in own.items()}
    if "delta_gamma" in own:
        own["delta_gamma"] = own["delta_gamma"][0]
    return options | own


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Record | Compare, description=__doc__)))
