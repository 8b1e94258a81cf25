"""Measure speed and quality, beside others where they are installed, and fill the pages with it.

A suite prints its tables and leaves a JSON of its figures in the output folder. In a checkout,
--publish also writes docs/results and fills README and docs from it, and `--suite all --publish`
takes every figure again; --pages fills the pages without a run, --check refuses stale ones.

`python -m benchmarks gallery`, `fields` and `input-plane` draw the pages' pictures.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from benchmarks.publishing import check_results, check_root, differing, fill, publish, stale
from benchmarks.registry import SUITES
from hcbf_gym.errors import InvalidInputError, choose, require
from hcbf_gym.evaluation.output_folder import write_json


@dataclass(frozen=True)
class Args:
    """Which figures to take, and what to do with them."""

    suite: tuple[str, ...] = ()
    """Names of suites, or all; without one, the suites are listed."""
    quick: bool = False
    """Fewer and shorter runs, whose figures say little."""
    publish: bool = False
    """Write docs/results/SUITE.json and fill the pages; needs a checkout and full runs."""
    pages: bool = False
    """Fill the tables of README and docs from docs/results."""
    check: bool = False
    """Fail if a page differs from docs/results; list the figures whose sources have changed."""
    root: Path = Path()
    """The checkout."""
    output: Path = Path("results/benchmark")
    """Folder for SUITE.json."""


def main(args: Args) -> None:
    """Run suites one after the other, and publish the figures if requested."""
    names = list(SUITES) if args.suite == ("all",) else list(args.suite)
    for name in names:
        suite = choose("suite", name, SUITES)
        require(f"suite {name}", suite.extra, *suite.needs)
    if args.publish and args.quick:
        raise InvalidInputError("publish: got quick figures, expected those of a full run")
    if args.publish or args.pages or args.check:
        check_root(args.root)
    if args.publish:
        check_results(args.root, but=names)
    console = Console()
    for name in names:
        figures = _plain(SUITES[name].run(args.quick))
        for table in SUITES[name].tables(figures).values():
            console.print(table.rich())
        args.output.mkdir(parents=True, exist_ok=True)
        write_json(args.output / f"{name}.json", figures)
        console.print(f"written to {args.output / name}.json")
        if args.publish:
            publish(args.root, name, figures)
    if args.publish or args.pages:
        for page in fill(args.root):
            console.print(f"filled {page}")
    if args.check:
        _check(args.root, console)
    if not (names or args.pages or args.check):
        width = max(map(len, SUITES))
        for name, suite in SUITES.items():
            console.print(f"{name:{width}}  {suite.does} ({suite.minutes:g} min)")
        total = sum(suite.minutes for suite in SUITES.values())
        console.print(f"{'all':{width}}  all of these ({total / 60:.1f} h)")


def _check(root: Path, console: Console) -> None:
    for name in stale(root):
        console.print(f"sources have changed since docs/results/{name}.json was taken")
    pages = [str(page) for page, _ in differing(root)]
    if pages:
        raise InvalidInputError(
            f"pages: got other tables than those of docs/results in {', '.join(pages)}, "
            "expected what `python -m benchmarks --pages` writes"
        )


def _plain(figures: Any) -> Any:
    """Return figures as JSON holds them: NumPy's as Python's, and None for infinities and NaN."""
    text = json.dumps(figures, default=lambda value: np.asarray(value).tolist())
    return json.loads(text, parse_constant=lambda _: None)
