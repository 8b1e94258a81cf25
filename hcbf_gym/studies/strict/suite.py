"""The evidence that rank 1 is never entered: every attack on every plant, and the worst found.

Each finished episode is a line of ``results/strict/outcomes.jsonl``. A run that was interrupted
goes on where it stopped, as long as the sources are the same.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import joblib
import numpy as np
from rich.progress import track

from hcbf_gym.compilation import sources_hash
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.programs import FilterStatus
from hcbf_gym.studies.strict import search
from hcbf_gym.studies.strict.attacks import ATTACKS
from hcbf_gym.studies.strict.episodes import AttackedEpisode, Outcome

FOLDER = Path("results/strict")
SCENARIOS = ("random", "random-moving")
FIRST_SEED = 50_000

PLANTS: dict[str, dict[str, Any]] = {
    "payload 4 kg, off-centre": {
        "randomization": {"payload": 4.0, "payload_position": [0.08, 0.05, 0.08]}
    },
    "motors x 0.8": {"randomization": {"motor_strength": 0.8}},
    "delay 8 ms": {"randomization": {"delay": 0.008}},
    "floor friction 0.4": {"randomization": {"floor_friction": 0.4}},
    "rough ground": {"terrain": "rough"},
    "all at once": {
        "terrain": "rough",
        "randomization": {
            "payload": 4.0,
            "payload_position": [0.08, 0.05, 0.08],
            "motor_strength": 0.8,
            "delay": 0.008,
            "floor_friction": 0.4,
        },
    },
}
"""Plants that differ from what the filter and the controller believe."""


class Line(NamedTuple):
    """One line of the table.

    Attributes:
        section: what is varied.
        name: how.
        attacks: the policies, `scenarios` for each of them.
        seeds: for each attack and scenario.
        options: of the environment.
        scenarios: what they are run in.
    """

    section: str
    name: str
    attacks: tuple[str, ...]
    seeds: int
    options: Mapping[str, Any] | None = None
    scenarios: tuple[str, ...] = ("random",)

    def episodes(self, quick: bool) -> list[AttackedEpisode]:
        """Return its episodes; with `quick` one for each attack and scenario, two seconds long."""
        options = dict(self.options or {}) | ({"max_episode_steps": 100} if quick else {})
        return [
            AttackedEpisode(attack, scenario, FIRST_SEED + k, env_options=options)
            for attack in self.attacks
            for scenario in self.scenarios
            for k in range(1 if quick else self.seeds)
        ]


AIMED = ("nearest", "corner", "edge")
LINES = (
    *(Line("nominal", name, (name,), 24, scenarios=SCENARIOS) for name in ATTACKS),
    *(Line("plant", name, AIMED, 8, options) for name, options in PLANTS.items()),
    Line("estimate", "20 Hz, 2 cm, 40 ms", AIMED, 16, {"estimation": {}}),
    Line("body", "footprint", AIMED, 8, {"body": "footprint"}),
    Line("policy", "pd", ("pd",), 48),
)
"""The table: every attack on the nominal plant, the aimed ones on others, and a friendly policy."""
TRIALS = 320
"""Attackers that the search tries."""


def run(quick: bool) -> dict[str, Any]:
    """Run every episode that is not done yet, and the search; return the table's figures."""
    rows = []
    for line in LINES[:: 5 if quick else 1]:
        outcomes = list(_outcomes(f"{line.section}: {line.name}", line.episodes(quick)))
        rows.append({"section": line.section, "name": line.name} | summary(outcomes))
    worst = search.worst_attack(trials=2 if quick else TRIALS)
    return {"groups": rows, "search": worst}


def summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return what a line of the table says of its episodes."""
    least = np.array([o.least_h for o in outcomes])
    speed = np.array([o.least_speed_h for o in outcomes])
    body = np.array([o.least_body_h for o in outcomes])
    counts = np.sum([o.status_counts for o in outcomes], axis=0)
    changed = least[[o.changed for o in outcomes]]
    return {
        "episodes": len(outcomes),
        "entered": int((least < 0.0).sum()),
        "least_h": float(least.min()),
        "speed_passed": int((speed < 0.0).sum()),
        "least_speed_h": float(speed.min()),
        "body_entered": int((body < 0.0).sum()),
        "least_body_h": float(body.min()),
        "falls": int(sum(o.fell for o in outcomes)),
        "warned": int(sum(o.warned for o in outcomes)),
        "qp_failures": int(sum(o.qp_failures for o in outcomes)),
        "reached": float(np.mean([o.reached for o in outcomes])),
        "median_margin": float(np.median([o.median_margin for o in outcomes])),
        "median_least_h": float(np.median(changed)) if changed.size else None,
        "status": {s.name: int(counts[s]) for s in FilterStatus},
    }


def _outcomes(title: str, episodes: Sequence[AttackedEpisode]) -> Iterator[Outcome]:
    """Yield the outcomes in order: those that are on file, and the others as they come."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    path = FOLDER / "outcomes.jsonl"
    version = sources_hash([Path(__file__)])
    known = {}
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            entry = json.loads(line)
            if entry["version"] == version:
                known[entry["episode"]] = entry["outcome"]
    keys = [json.dumps(asdict(episode), sort_keys=True) for episode in episodes]
    missing = [k for k, key in enumerate(keys) if key not in known]
    parallel = joblib.Parallel(n_jobs=-1, return_as="generator")
    fresh = parallel(joblib.delayed(episodes[k].run)() for k in missing)
    with path.open("a", encoding="utf-8") as file:
        for k, outcome in zip(missing, track(fresh, title, len(missing)), strict=True):
            assert outcome is not None
            known[keys[k]] = asdict(outcome)
            entry = {"version": version, "episode": keys[k], "outcome": known[keys[k]]}
            file.write(json.dumps(entry) + "\n")
            file.flush()
    for key in keys:
        fields = known[key]
        yield Outcome(**fields | {"status_counts": tuple(fields["status_counts"])})


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the table of all groups, and the search's."""
    header = (
        "",
        "episodes",
        "entered",
        "least h [m]",
        "speed limit passed",
        "by at most [m/s]",
        "falls",
        "goals",
        "median margin [m]",
        "warnings",
        "OUTSIDE, VIOLATED, BACKUP steps",
    )
    rows = []
    for group in figures["groups"]:
        status = group["status"]
        rows.append(
            (
                f"{group['section']}: {group['name']}",
                str(group["episodes"]),
                str(group["entered"]),
                f"{group['least_h']:+.3f}",
                str(group["speed_passed"]),
                f"{max(0.0, -group['least_speed_h']):.3f}",
                str(group["falls"]),
                f"{group['reached']:.0%}",
                f"{group['median_margin']:.3f}",
                str(group["warned"]),
                f"{status['OUTSIDE']}, {status['VIOLATED']}, {status['BACKUP']}",
            )
        )
    found = figures["search"]
    rows.append(
        (
            f"searched attackers, {found['trials']} evaluations",
            str(found["trials"]),
            str(found["entered"]),
            f"{found['least_h']:+.3f}",
            str(found["speed_passed"]),
            f"{max(0.0, -found['least_speed_h']):.3f}",
            str(found["falls"]),
            "",
            "",
            "",
            "",
        )
    )
    return {"attacks": Table("attacks on the strict rank, lex-cbf-qp", header, rows)}
