"""Whether the programs still give the answers that they once gave, state by state.

``python -m benchmarks.same_answers record FILE`` draws states, filters them with every program and
writes both to a file; ``compare FILE`` filters the same states again and lists what differs. The
file holds the rows themselves, so that only the programs are compared.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

from hcbf_gym import programs, scenarios
from hcbf_gym.barriers.rows import RowSettings
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.models.input_sets import Ball, Box, InputSet
from hcbf_gym.programs import CbfRows, FilterResult

Array = NDArray[np.float64]

TOLERANCE = 1e-9
"""Largest difference of u, slack or δ that counts as the same answer; slack relative to 1 + |b|."""
GROUP = 250
"""States that share the number of rows, U and the options of the programs."""
GENERAL = 6
"""States of a group that QP solvers filter as well; they take a thousand times longer."""
FAMILIES = ("random", "random-moving", "paper-simulation", "conflicts", "steep", "graded")
"""Where rows come from: scenes; states inside several regions; gradients from .03 to 30; gradients
that differ by up to 1e9 within one level."""
SETS: tuple[InputSet, ...] = (Box.symmetric(5.0), Ball(5.0), Box([-1.0, 0.0], [4.0, 2.5]))
FIELDS = ("a", "b", "h", "priority", "alpha2_psi", "u_nominal")


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
    pool, stored = _pool(), {}
    for group in range(-(-states // GROUP)):
        rng = np.random.default_rng([seed, group])
        drawn = _draw(rng, FAMILIES[group % len(FAMILIES)], pool)
        stored |= {f"{group}/{name}": drawn[name] for name in FIELDS}
        for key, answer in answers(group, drawn):
            for name in ("u", "slack", "delta", "status"):
                stored[f"{group}/{key}/{name}"] = np.asarray(getattr(answer, name))
    with file.open("wb") as out:
        np.savez(out, **stored, seed=np.array(seed))


def compare(file: Path) -> int:
    """Filter a file's states again and print what differs; return 1 if anything does."""
    counts: dict[tuple[str, str], list[float]] = {}
    with np.load(file) as stored:
        group = 0
        while f"{group}/b" in stored:
            drawn = {name: stored[f"{group}/{name}"] for name in FIELDS}
            for key, answer in answers(group, drawn):
                old = {
                    name: stored[f"{group}/{key}/{name}"]
                    for name in ("u", "slack", "delta", "status")
                }
                scale = 1.0 + np.abs(drawn["b"][: len(old["u"])])
                line = counts.setdefault((key, FAMILIES[group % len(FAMILIES)]), [0] * 6)
                _count(line, old, answer, scale)
            group += 1
    print(
        f"{'program form':24} {'family':16} {'states':>7} {'differ':>7} {'status':>7}  largest |Δ|"
    )
    for (key, family), (total, status, other, *largest) in sorted(counts.items()):
        if other:
            sizes = " ".join(f"{n} {gap:.1e}" for n, gap in zip("usδ", largest, strict=True))
            print(f"{key:24} {family:16} {total:7} {other:7} {status:7}  {sizes}")
    total, differ = (sum(line[k] for line in counts.values()) for k in (0, 2))
    print(f"{differ} of {total} answers differ by more than {TOLERANCE:g} or in their status")
    return int(differ > 0)


def _count(line: list[float], old: dict[str, Any], new: FilterResult, scale: Array) -> None:
    gaps = (
        np.abs(new.u - old["u"]).max(axis=1),
        (np.abs(new.slack - old["slack"]) / scale).max(axis=1, initial=0.0),
        (np.abs(new.delta - old["delta"]) / scale).max(axis=1, initial=0.0),
    )
    status = np.asarray(new.status) != old["status"]
    line[0] += len(status)
    line[1] += int(status.sum())
    line[2] += int((status | (np.max(gaps, axis=0) > TOLERANCE)).sum())
    line[3:] = [max(most, float(gap.max())) for most, gap in zip(line[3:], gaps, strict=True)]


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


# ------------------------------------------------------------------ states


def _pool() -> dict[str, list[Any]]:
    """Return barriers of the package's own scenes by family."""
    rng = np.random.default_rng(0)
    made = {name: [scenarios.make(name, rng) for _ in range(60)] for name in FAMILIES[:2]}
    made["paper-simulation"] = [scenarios.make("paper-simulation")]
    return {name: [list(one.barriers) for one in scenes] for name, scenes in made.items()}


def _draw(rng: np.random.Generator, family: str, pool: dict[str, list[Any]]) -> dict[str, Any]:
    """Return the rows of a group's states and their nominal inputs."""
    m = int(rng.integers(1, 13))
    drawn = _degenerate(rng, m) if family == "graded" else _of_scenes(rng, family, m, pool)
    if family == "steep":
        factor = 10.0 ** rng.uniform(-1.5, 1.5, (GROUP, m))
        drawn |= {"a": drawn["a"] * factor[..., None], "b": drawn["b"] * factor}
    levels = rng.integers(0, rng.integers(1, m + 1, (GROUP, 1)), (GROUP, m))
    ranks = np.stack([np.unique(p, return_inverse=True)[1] for p in levels]) + 1
    drawn["priority"] = ranks.astype(np.int64)
    u = rng.normal(0.0, 3.0, (GROUP, 2)) * rng.choice([1.0, 30.0], (GROUP, 1), p=[0.85, 0.15])
    return drawn | {"u_nominal": u}


def _of_scenes(
    rng: np.random.Generator, family: str, m: int, pool: dict[str, list[Any]]
) -> dict[str, Any]:
    """Return rows of m barriers of one scene, or of several where one has fewer."""
    scenes = pool[family] if family in pool else [*pool["random"], *pool["random-moving"]]
    chosen, x = [], np.empty((GROUP, 4))
    for i in range(GROUP):
        barriers = list(scenes[rng.integers(len(scenes))])
        while len(barriers) < m:
            barriers += scenes[rng.integers(len(scenes))]
        barriers = [barriers[k] for k in rng.permutation(len(barriers))[:m]]
        chosen.append(tuple(barriers))
        places = [_place(barrier) for barrier in barriers]
        places = [place for place in places if place is not None]
        spread = 0.15 if family == "conflicts" else 0.8
        middle = np.mean(places[:2], axis=0) if places else np.zeros(2)
        x[i] = *(middle + rng.normal(0.0, spread, 2)), *rng.normal(0.0, 0.7, 2)
    held = rng.random() < 0.5
    settings = RowSettings(period=0.02, u_max=float(np.hypot(5.0, 5.0))) if held else RowSettings()
    rows = BarrierSet(chosen).rows(x, rng.uniform(0.0, 5.0, GROUP), settings)
    assert rows.alpha2_psi is not None
    return {"a": rows.a, "b": rows.b, "h": rows.h, "alpha2_psi": rows.alpha2_psi}


def _place(barrier: Any) -> Any:
    """Return the middle of a region, None for what has none."""
    if hasattr(barrier, "center"):
        return np.array(barrier.center, dtype=float)
    corners = getattr(barrier, "corners", getattr(barrier, "vertices", None))
    return None if corners is None or callable(corners) else np.mean(corners, axis=0)


def _degenerate(rng: np.random.Generator, m: int) -> dict[str, Any]:
    """Return rows with gradients down to 1e-9, zero rows, and exactly parallel copies."""
    direction = rng.normal(0.0, 1.0, (GROUP, m, 2))
    length = rng.lognormal(0.0, 0.7, (GROUP, m))
    a = direction * (length / np.linalg.norm(direction, axis=-1))[..., None]
    b = length * rng.normal(0.0, 4.0, (GROUP, m))
    kind = rng.choice(5, (GROUP, m), p=[0.6, 0.12, 0.05, 0.15, 0.08])
    faint = np.where(kind == 1, 10.0 ** rng.uniform(-9.0, -2.0, (GROUP, m)), 1.0)
    a, b = a * faint[..., None], b * np.where(rng.random((GROUP, m)) < 0.7, faint, 1.0)
    a[kind == 2] = 0.0
    index = np.arange(GROUP)
    for k in range(1, m):
        source = rng.integers(0, k, GROUP)
        factor = 2.0 ** rng.integers(-2, 3, GROUP) * rng.choice([-1.0, 1.0], GROUP)
        copied, same = kind[:, k] >= 3, kind[:, k] == 4
        a[:, k] = np.where(copied[:, None], factor[:, None] * a[index, source], a[:, k])
        b[:, k] = np.where(same, factor * b[index, source], b[:, k])
    h = rng.normal(0.0, 1.0, (GROUP, m))
    return {"a": a, "b": b, "h": h, "alpha2_psi": rng.normal(0.0, 2.0, (GROUP, m))}


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Record | Compare, description=__doc__)))
