"""Whether the A1's filter notices plants that nobody declared, and lets declared ones walk.

``python -m benchmarks.plants undeclared`` runs one part on all cores and prints a table. Finished
episodes are kept in ``results/plants``: a run that was interrupted goes on where it stopped.
"""

import functools
import json
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from benchmarks.strict import lines
from benchmarks.strict.outcomes import outcomes
from hcbf_gym import wrappers
from hcbf_gym.envs.a1_plant import V_MAX
from hcbf_gym.evaluation import attacks
from hcbf_gym.evaluation.attacked import wants
from hcbf_gym.evaluation.episode import Sample, samples
from hcbf_gym.evaluation.statistics import BOUNDED, counted
from hcbf_gym.evaluation.workers import Workers
from hcbf_gym.models.plant import Reason
from hcbf_gym.programs import FilterStatus

FAMILIES = ("random", "random-moving")
HOSTILE = tuple(attacks.ATTACKS)
AIMED = ("edge", "corner", "nearest", "bang-bang")
FIRST_SEED = 5_000_000
SECONDS = 20.0
STOOD = 75
"""Steps at rest after which an episode that the filter has braked is over."""


@dataclass(frozen=True)
class Episode:
    """One episode.

    Args:
        group: the line of the table that it belongs to.
        policy: an attack's or a policy's name.
        scenario: a family of random scenes.
        seed: of the environment and the attack.
        change: what becomes of the plant, ("floor" | "delay" | "motors" | "mass", number).
        when: from which time on [s].
        env_options: further arguments of the environment.
        filter_options: arguments of `SafetyFilter`.
        env: the environment's id.
        v_max: another cap on the speed than the scene's own [m/s].
        seconds: how long it is.
        stops: whether it ends with the first alarm.
    """

    group: str
    policy: str
    scenario: str
    seed: int
    change: tuple[str, float] | None = None
    when: float = 0.0
    env_options: dict[str, Any] = field(default_factory=dict)
    filter_options: dict[str, Any] = field(default_factory=dict)
    env: str = "HCBF-A1Regions-v0"
    v_max: float | None = None
    seconds: float = SECONDS
    stops: bool = False

    def run(self) -> dict[str, Any]:
        """Run it, and return what it showed."""
        warnings.simplefilter("ignore")
        scene: Any = self.scenario
        options = None
        if self.v_max is not None:
            scene = lines.faster(self.scenario, 0, self.v_max)
            drawn = lines.faster(self.scenario, self.seed, self.v_max)
            options = {"scenario": drawn}
        arguments = scene, self.env_options, self.filter_options
        env = _environment(self.env, json.dumps(arguments, sort_keys=True))
        walk = samples(env, wants(self.policy, env, self.seed), self.seed, options)
        next(walk)
        inner: Any = env.unwrapped
        heavy = _masses(inner)
        try:
            return self._follow(inner, walk)
        finally:
            for array, value in heavy:
                array[:] = value

    def _follow(self, inner: Any, walk: Iterator[Sample]) -> dict[str, Any]:
        strict = [k for k, b in enumerate(inner.barriers) if b.priority == 1]
        position = [k for k in strict if inner.barriers[k].reads_position]
        speed = [k for k in strict if not inner.barriers[k].reads_position]
        least, changed, stood, alarm = [], self.change is None, 0, None
        ended, sample = False, None
        counts, reason, where_changed, fastest = np.zeros(len(FilterStatus), int), 0, False, np.inf
        while not ended and inner.time < self.seconds - 1e-9:
            if not changed and inner.time >= self.when - 1e-9:
                change_plant(inner.simulation, *self.change)  # type: ignore[misc]
                changed = True
            sample = next(walk)
            info = sample.info
            report = info["safety_filter"]
            least.append(float(info["min_h"][position].min()))
            fastest = min(fastest, float(info["min_h"][speed].min(initial=np.inf)))
            counts[int(report["status"])] += 1
            where_changed = where_changed or bool(report["intervention"] > 1e-3)
            if report["reason"] and alarm is None:
                alarm, reason = float(inner.time), int(report["reason"])
            braked = report["status"] == FilterStatus.BACKUP
            stood = stood + 1 if braked and np.abs(inner.estimate.x[2:]).max() < 1e-6 else 0
            ended = sample.over or stood > STOOD or (self.stops and alarm is not None)
        assert sample is not None
        info = sample.info
        entered = np.flatnonzero(np.array(least) < 0.0)
        return {
            "alarm": alarm,
            "reason": reason,
            "entered": 0.02 * float(entered[0] + 1) if len(entered) else None,
            "least_h": min(least),
            "least_speed_h": fastest,
            "changed": where_changed,
            "fell": bool(info.get("fallen", 0.0)),
            "reached": bool(sample.terminated) and not info.get("fallen", 0.0),
            "covered": int(info["safety_filter"]["covered"]),
            "status": counts.tolist(),
        }


@functools.lru_cache(maxsize=3)
def _environment(env_id: str, arguments: str) -> gym.Env:
    """Return a filtered environment, made once for all episodes with these arguments."""
    scene, env_options, filter_options = json.loads(arguments)
    env = gym.make(env_id, scenario=scene, **env_options)
    return wrappers.SafetyFilter(env, **({"program": "lex-cbf-qp"} | filter_options))


def _masses(inner: Any) -> list[tuple[Any, Any]]:
    """Return the arrays that "mass" changes, with what stands in them now."""
    if not hasattr(inner, "simulation"):
        return []
    model = inner.simulation.model
    arrays = model.body_mass, model.body_inertia, model.body_subtreemass
    return [(array, array.copy()) for array in arrays]


def change_plant(simulation: Any, what: str, number: float) -> None:
    """Make another plant of a running one, behind everybody's back."""
    if what == "floor":
        simulation.model.geom_friction[simulation._feet, 0] = number
    elif what == "delay":
        waiting = simulation._delayed
        for _ in range(round(number / simulation.model.opt.timestep) - len(waiting)):
            waiting.appendleft(waiting[0].copy())
    elif what == "motors":
        simulation.conditions = simulation.conditions._replace(motor_strength=number)
    else:
        for array, value in _masses(type("Of", (), {"simulation": simulation})):
            array[:] = number * value


def _group(
    name: str,
    count: int,
    policies: tuple[str, ...],
    first: int,
    families: tuple[str, ...] = FAMILIES,
    **rest: Any,
) -> Iterator[Episode]:
    """Yield a line's episodes, its policies and families in turn."""
    for k in range(count):
        family = families[k % len(families)]
        policy = policies[(k // len(families)) % len(policies)]
        yield Episode(name, policy, family, FIRST_SEED + first + k, **rest)


def _randomized(**ranges: Any) -> dict[str, Any]:
    return {"randomization": ranges}


DECLARED: dict[str, dict[str, Any]] = {
    "nominal": {},
    "footprint": {"body": "footprint"},
    "feedback rom": {"feedback": "rom"},
    "timestep .001": {"timestep": 0.001},
    "timestep .005": {"timestep": 0.005},
    "friction .3": {"friction": 0.3},
    "friction .45": {"friction": 0.45},
    "rough ground": {"terrain": "rough"},
    "floor .4": _randomized(floor_friction=0.4),
    "floor .5 to .7": _randomized(floor_friction=[0.5, 0.7]),
    "payload to 4 kg": _randomized(payload=[0.0, 4.0]),
    "payload 4 kg, farthest": lines.PLANTS["payload 4 kg, off-centre"],
    "motors .8": _randomized(motor_strength=0.8),
    "motors .8 to 1": _randomized(motor_strength=[0.8, 1.0]),
    "delay 8 ms": _randomized(delay=0.008),
    "delay to 8 ms": _randomized(delay=[0.0, 0.008]),
    "noise .5": _randomized(sensor_noise=0.5),
    "noise to .5": _randomized(sensor_noise=[0.0, 0.5]),
    "all at once": lines.PLANTS["all at once"],
    "pushes of 2 N·s": {"disturbances": {"kind": "random", "interval": 2.0, "impulse": [2.0, 2.0]}},
    "motion capture": {"estimation": "motion-capture"},
    "LiDAR": {"estimation": "lidar"},
    "UWB": {"estimation": "uwb"},
    "fix of 2 cm": {"estimation": {}},
}
"""Plants that are declared and, at a cap of 1 m/s, covered: within their bounds and at them."""

BEYOND: dict[str, dict[str, Any]] = {
    "timestep .0005": {"timestep": 0.0005},
    "friction .7 by hand": {"friction": 0.7},
    "friction .2 by hand": {"friction": 0.2},
    "floor .35": _randomized(floor_friction=0.35),
    "floor .8 to 1": _randomized(floor_friction=[0.8, 1.0]),
    "payload 5 kg": _randomized(payload=5.0),
    "payload 4 kg at x .15": _randomized(payload=4.0, payload_position=[0.15, 0.0, 0.08]),
    "motors .75": _randomized(motor_strength=0.75),
    "delay 12 ms": _randomized(delay=0.012),
    "noise .8": _randomized(sensor_noise=0.8),
    "pushes of 4 N·s": {"disturbances": {"kind": "random", "interval": 2.0, "impulse": [4.0, 4.0]}},
    "pushes every 1 s": {
        "disturbances": {"kind": "random", "interval": 1.0, "impulse": [2.0, 2.0]}
    },
    "fix of 15 cm": {"estimation": {"noise": 0.15}},
    "feedback measured": {"feedback": "measured"},
    "LiDAR and floor .4": {"estimation": "lidar"} | _randomized(floor_friction=0.4),
}
"""Plants that are declared and lie beyond a bound."""

UNDECLARED = {
    "floor .4": ("floor", 0.4),
    "8 ms late": ("delay", 0.008),
    "16 ms late": ("delay", 0.016),
}


def episodes(part: str) -> list[Episode]:
    """Return the episodes of a part, see `main`; random scenes have a cap of 1 m/s themselves."""
    found: list[Episode] = []
    if part in ("undeclared", "undeclared-slow"):
        v_max = V_MAX if part == "undeclared" else None
        for n, (name, change) in enumerate(UNDECLARED.items()):
            for when in (0.0, 4.0):
                for mode in ("brake", "warn"):  # on the same seeds
                    found += _group(
                        f"{name} from {when:g} s, {mode}", 50, AIMED, 10_000 * n,
                        change=change, when=when, v_max=v_max,
                        filter_options={"on_alarm": mode},
                    )  # fmt: skip
    elif part == "heavy":
        for n, change in enumerate((("motors", 0.8), ("mass", 1.2))):
            for when in (0.0, 4.0):
                found += _group(
                    f"{change[0]} × {change[1]} from {when:g} s", 50, AIMED, 100_000 + 10_000 * n,
                    change=change, when=when, seconds=when + 2.5, stops=True,
                )  # fmt: skip
    elif part == "declared":
        for n, (name, options) in enumerate(DECLARED.items()):
            found += _group(name, 50, HOSTILE, 200_000 + 1_000 * n, env_options=options)
        for n, v_max in enumerate((0.5, 1.7)):
            for k, name in enumerate(("nominal", "footprint")):
                found += _group(
                    f"{name}, cap {v_max}", 24, HOSTILE, 300_000 + 1_000 * (2 * n + k),
                    env_options=DECLARED[name], v_max=v_max,
                )  # fmt: skip
    elif part == "fast":
        for n, (name, options) in enumerate(DECLARED.items()):
            found += _group(
                name, 24, HOSTILE, 320_000 + 1_000 * n, env_options=options, v_max=V_MAX
            )  # fmt: skip
    elif part == "beyond":
        for n, (name, options) in enumerate(BEYOND.items()):
            for v_max in (None, V_MAX):
                cap = 1.0 if v_max is None else v_max
                found += _group(
                    f"{name}, cap {cap}", 24, HOSTILE, 360_000 + 1_000 * n, env_options=options,
                    v_max=v_max,
                )  # fmt: skip
    elif part == "nominal":
        found += _group("hostile", 200, HOSTILE, 400_000)
        found += _group("PD", 100, ("pd",), 50_000 - FIRST_SEED, ("random",))
        found += _group(
            "PD, guided", 100, ("pd",), 420_000, ("random",),
            filter_options={"guidance": "geodesic"},
        )  # fmt: skip
    elif part == "reduced":
        found += _group("hostile", 200, HOSTILE, 500_000, env="HCBF-Regions-v0")
        found += _group("PD", 100, ("pd",), 510_000, env="HCBF-Regions-v0")
    return found


def table(part: str, groups: dict[str, list[dict[str, Any]]]) -> Table:
    """Return what each line of a part showed."""
    header = (
        "", "episodes", f"entered ({BOUNDED})", "of these warned before", "alarmed",
        "within 2 s", "least h [m]", "speed limit passed", "falls", "goals",
        "median least h where u changed [m]", "covered", "reasons",
    )  # fmt: skip
    shown = Table(*header, title=part)
    for name, told in groups.items():
        entered = [o for o in told if o["entered"] is not None]
        alarmed = [o for o in told if o["alarm"] is not None]
        before = [o for o in entered if o["alarm"] is not None and o["alarm"] <= o["entered"]]
        late = [o["alarm"] - o["when"] for o in alarmed]
        changed = [o["least_h"] for o in told if o["changed"]]
        reasons = Counter(Reason(o["reason"]).name for o in alarmed)
        shown.add_row(
            name, str(len(told)), counted(len(entered), len(told)), str(len(before)),
            str(len(alarmed)),
            str(sum(seconds <= 2.0 for seconds in late)),
            f"{min(o['least_h'] for o in told):+.3f}",
            str(sum(o["least_speed_h"] < 0.0 for o in told)),
            str(sum(o["fell"] for o in told)), str(sum(o["reached"] for o in told)),
            f"{np.median(changed):+.3f}" if changed else "",
            ", ".join(map(str, sorted({o["covered"] for o in told}))),
            ", ".join(f"{reason} {count}" for reason, count in reasons.items()),
        )  # fmt: skip
    return shown


def main(part: tyro.conf.Positional[str], only: str = "", workers: Workers = None) -> None:
    """Run a part of the evidence.

    Args:
        part: undeclared (at the default cap), undeclared-slow (at 1 m/s), heavy, declared (at
            1 m/s), fast (the same plants at the default cap), beyond, nominal or reduced.
        only: the lines of it whose name has this in it.
        workers: episodes that run at once.
    """
    asked = [episode for episode in episodes(part) if only in episode.group]
    seen = outcomes(asked, Path("results/plants"), title=part, workers=workers)
    groups: dict[str, list[dict[str, Any]]] = {}
    for episode, outcome in zip(asked, seen, strict=True):
        groups.setdefault(episode.group, []).append(outcome | {"when": episode.when})
    Console().print(table(part, groups))


if __name__ == "__main__":
    from benchmarks import plants  # under its own name, by which workers find it

    tyro.cli(plants.main)
