"""The evidence that rank 1 is never entered: every attack on every plant, and the worst found.

Finished episodes are kept in ``results/strict``. A run that was interrupted continues
there, as long as the sources are the same.
"""

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import table
from benchmarks.strict import pushed, search
from benchmarks.strict.lines import LINES
from hcbf_gym.evaluation.attacked import Outcome
from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_gym.evaluation.statistics import BOUNDED, counted
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.programs import FilterStatus

FOLDER = Path("results/strict")
DEPENDS = (  # What outcomes depend on besides what their episodes import
    "hcbf_gym/envs/a1_regions.py",
    "hcbf_gym/robots/a1/a1.xml",
    "hcbf_gym/policies/baselines/*",
)
TRIALS = 2000  # Attackers that the search tries

Group = dict[str, Any]
Column = str | Callable[[Any], str]


def run(quick: bool) -> dict[str, Any]:
    """Run every episode that is not done yet, and the search; return the tables' figures."""
    root = Path(__file__).parents[2]
    besides = [file for pattern in DEPENDS for file in root.glob(pattern)]
    kept = functools.partial(outcomes, folder=FOLDER, reads=besides)
    first = {line.section: line for line in reversed(LINES)}
    groups = []
    for line in reversed(first.values()) if quick else LINES:
        seen = kept(line.episodes(quick), title=f"{line.section}: {line.name}")
        groups.append({"section": line.section, "name": line.name} | summary(seen))
    return {
        "groups": groups,
        "search": search.worst_attack(2 if quick else TRIALS, kept),
        "pushed": pushed.run(quick, kept),
    }


def outcomes(
    episodes: Sequence[Any], folder: Path, reads: Sequence[Path] = (), title: str | None = None
) -> list[Any]:
    """Return what episodes of one class showed, in order; what is in the folder is not run again.

    `reads` are files that decide them beside the sources of their class.
    """
    run = type(episodes[0]).run
    return in_order(Runs(folder).over(run, episodes, title, reads))


def summary(seen: Sequence[Outcome]) -> Group:
    """Return a line of the tables from its episodes."""
    least = np.array([o.least_h for o in seen])
    speed = np.array([o.least_speed_h for o in seen])
    second = np.array([o.least_second_h for o in seen])
    body = np.array([o.least_body_h for o in seen])
    counts = np.sum([o.status_counts for o in seen], axis=0)
    changed = least[[o.changed for o in seen]]
    return {
        "episodes": len(seen),
        "entered": int((least < 0.0).sum()),
        "least_h": float(least.min()),
        "speed_passed": int((speed < 0.0).sum()),
        "least_speed_h": float(speed.min()),
        "second_entered": int((second < 0.0).sum()),
        "least_second_h": float(second.min()),
        "body_entered": int((body < 0.0).sum()),
        "least_body_h": float(body.min()),
        "reach": max(o.reach for o in seen),
        "falls": int(sum(o.fell for o in seen)),
        "warned": int(sum(o.warned for o in seen)),
        "qp_failures": int(sum(o.qp_failures for o in seen)),
        "reached": float(np.mean([o.reached for o in seen])),
        "median_margin": float(np.median([o.median_margin for o in seen])),
        "median_least_h": float(np.median(changed)) if changed.size else None,
        "status": {s.name: int(counts[s]) for s in FilterStatus},
        **_estimator(seen),
    }


def _estimator(seen: Sequence[Outcome]) -> dict[str, float]:
    """Return the position's error and the consistency, where an estimator was at work."""
    errors = [o.position_error for o in seen if o.position_error is not None]
    if not errors:
        return {}
    return {
        "position_rms": float(np.sqrt(np.mean(np.square(errors)))),
        "nees": float(np.mean([o.nees for o in seen if o.nees is not None])),
        "nees_inside": float(np.mean([o.nees_inside for o in seen if o.nees_inside is not None])),
    }


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the tables: attacks, the search, body, estimate, rank 2, and pushes."""
    groups = figures["groups"]

    def of(title: str, chosen: Callable[[Group], bool], *more: Mapping[str, Column]) -> Table:
        columns = {header: cell for some in more for header, cell in some.items()}
        return summaries(title, filter(chosen, groups), columns)

    goals, margin = {"goals": "{reached:.0%}"}, {"median margin [m]": _metres("median_margin")}
    plain = ("nominal", "cap", "policy", "plant", "estimate")
    return {
        "attacks": of(
            "attacks on the strict rank, lex-cbf-qp",
            lambda g: g["section"] in plain,
            _count("speed limit passed", "speed_passed"),
            {"by at most [m/s]": lambda g: f"{max(0.0, -g['least_speed_h']):.3f}"},
            goals,
            {"median least h where u changed [m]": _metres("median_least_h")},
            margin,
            {
                "false warnings": "{warned}",
                "UNSAFE, VIOLATED, BACKUP steps": "{status[UNSAFE]}, {status[VIOLATED]}, "
                "{status[BACKUP]}",
                "QP failures": "{qp_failures}",
            },
        ),
        "search": search.tables(figures["search"]),
        "body": of(
            'the whole robot, body="footprint", lex-cbf-qp',
            lambda g: g["section"] == "body",
            _count("a geom inside", "body_entered"),
            {"least h of the geoms [m]": _metres("least_body_h")},
            {"greatest reach [m]": "{reach:.3f}"},
            goals,
        ),
        "estimate": of(
            "what a fix of 2 cm at 20 Hz, 40 ms late, costs and knows",
            lambda g: "nees" in g or g["section"] == "policy",
            {
                "position error, RMS [m]": _metres("position_rms"),
                "NEES (4 is consistent)": lambda g: f"{g['nees']:.2f}" if "nees" in g else "",
                "instants in the 95 % band": lambda g: (
                    f"{g['nees_inside']:.0%}" if "nees" in g else ""
                ),
            },
            margin,
            goals,
        ),
        "rank-2": of(
            "rank 2 where no conflict forces it, lex-cbf-qp",
            lambda g: g["section"] == "rank 2",
            _count("rank 2 entered", "second_entered"),
            {"least h of rank 2 [m]": _metres("least_second_h")},
            goals,
        ),
        "pushed": pushed.tables(figures["pushed"]),
    }


def summaries(title: str, groups: Iterable[Group], more: Mapping[str, Column]) -> Table:
    """Return a table of groups: what all of them have, and more."""
    columns = {"": "{section}: {name}", "episodes": "{episodes}"} | _count("entered", "entered")
    columns |= {"least h [m]": _metres("least_h"), "falls": "{falls}"}
    return table(title, groups, columns | dict(more))


def _count(header: str, key: str) -> dict[str, Column]:
    return {f"{header} ({BOUNDED})": lambda g: counted(g[key], g["episodes"])}


def _metres(key: str) -> Column:
    return lambda g: "" if g.get(key) is None else f"{g[key]:+.3f}"
