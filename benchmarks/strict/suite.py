"""The evidence that rank 1 is never entered: every attack on every plant, and the worst found.

Finished episodes are kept in ``results/strict``. A run that was interrupted goes on where it
stopped, as long as the sources are the same.
"""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.strict import pushed, search
from benchmarks.strict.lines import LINES
from hcbf_gym.evaluation.attacked import Outcome
from hcbf_gym.evaluation.jobs import Runs, in_order
from hcbf_gym.evaluation.statistics import BOUNDED, counted
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.programs import FilterStatus

FOLDER = Path("results/strict")
DEPENDS = (
    "hcbf_gym/envs/a1_regions.py",
    "hcbf_gym/robots/a1/a1.xml",
    "hcbf_gym/policies/baselines/*",
)
"""What outcomes depend on besides what their episodes import."""
TRIALS = 2000
"""Attackers that the search tries."""

Group = dict[str, Any]


def run(quick: bool) -> dict[str, Any]:
    """Run every episode that is not done yet, and the search; return the tables' figures.

    Args:
        quick: the first line of each section, shorter, and few attackers.
    """
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

    Args:
        episodes: dataclasses with a `run`.
        folder: where finished ones are kept.
        reads: files that decide them beside the sources of their class.
        title: of a progress bar; none is shown without one.
    """
    run = type(episodes[0]).run
    return in_order(Runs(folder).over(run, episodes, title, reads))


def summary(seen: Sequence[Outcome]) -> Group:
    """Return what a line of the tables says of its episodes."""
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
    attacks = table(
        "attacks on the strict rank, lex-cbf-qp",
        [g for g in groups if g["section"] in ("nominal", "cap", "policy", "plant", "estimate")],
        {
            f"speed limit passed ({BOUNDED})": lambda g: counted(g["speed_passed"], g["episodes"]),
            "by at most [m/s]": lambda g: f"{max(0.0, -g['least_speed_h']):.3f}",
            "goals": lambda g: f"{g['reached']:.0%}",
            "median least h where u changed [m]": lambda g: _metres(g["median_least_h"]),
            "median margin [m]": lambda g: _metres(g["median_margin"]),
            "false warnings": lambda g: str(g["warned"]),
            "UNSAFE, VIOLATED, BACKUP steps": _bad_steps,
            "QP failures": lambda g: str(g["qp_failures"]),
        },
    )
    return {
        "attacks": attacks,
        "search": search.table(figures["search"]),
        "body": table(
            'the whole robot, body="footprint", lex-cbf-qp',
            [g for g in groups if g["section"] == "body"],
            {
                f"a geom inside ({BOUNDED})": lambda g: counted(g["body_entered"], g["episodes"]),
                "least h of the geoms [m]": lambda g: _metres(g["least_body_h"]),
                "greatest reach [m]": lambda g: f"{g['reach']:.3f}",
                "goals": lambda g: f"{g['reached']:.0%}",
            },
        ),
        "estimate": table(
            "what a fix of 2 cm at 20 Hz, 40 ms late, costs and knows",
            [g for g in groups if "nees" in g or g["section"] == "policy"],
            {
                "position error, RMS [m]": lambda g: _metres(g.get("position_rms")),
                "NEES (4 is consistent)": lambda g: f"{g['nees']:.2f}" if "nees" in g else "",
                "instants in the 95 % band": lambda g: (
                    f"{g['nees_inside']:.0%}" if "nees" in g else ""
                ),
                "median margin [m]": lambda g: _metres(g["median_margin"]),
                "goals": lambda g: f"{g['reached']:.0%}",
            },
        ),
        "rank-2": table(
            "rank 2 where no conflict forces it, lex-cbf-qp",
            [g for g in groups if g["section"] == "rank 2"],
            {
                f"rank 2 entered ({BOUNDED})": lambda g: counted(
                    g["second_entered"], g["episodes"]
                ),
                "least h of rank 2 [m]": lambda g: _metres(g["least_second_h"]),
                "goals": lambda g: f"{g['reached']:.0%}",
            },
        ),
        "pushed": pushed.table(figures["pushed"]),
    }


def table(title: str, groups: Sequence[Group], more: dict[str, Callable[[Group], str]]) -> Table:
    """Return a table of groups: what all of them tell, and more."""
    columns: dict[str, Callable[[Group], str]] = {
        "": lambda g: f"{g['section']}: {g['name']}",
        "episodes": lambda g: str(g["episodes"]),
        f"entered ({BOUNDED})": lambda g: counted(g["entered"], g["episodes"]),
        "least h [m]": lambda g: _metres(g["least_h"]),
        "falls": lambda g: str(g["falls"]),
        **more,
    }
    rows = [tuple(column(group) for column in columns.values()) for group in groups]
    return Table(title, tuple(columns), rows)


def _metres(value: float | None) -> str:
    return "" if value is None else f"{value:+.3f}"


def _bad_steps(group: Group) -> str:
    status = group["status"]
    return f"{status['UNSAFE']}, {status['VIOLATED']}, {status['BACKUP']}"
