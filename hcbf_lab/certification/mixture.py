"""The A1 in everything that is covered at once, drawn for each episode from its seed.

>>> family = A1Mixture()
>>> family.episode(7) == family.episode(7)
True
>>> print(family.words[0])
The environment is HCBF-A1Regions-v0, with a plant, a cap and a scene of its own in each episode.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym import scenarios
from hcbf_gym.certificates.judge import words
from hcbf_gym.envs.a1_plant import V_MAX
from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.envs.task import PHYSICS_DT
from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.estimation import sensors
from hcbf_gym.evaluation.attacked import AttackedEpisode
from hcbf_gym.evaluation.attacks import ATTACKS

STREAM = 23
"""Sets the mixture's draws apart from those that the environment makes with the same seed."""

SCENES = ("random", "random-moving", "random-wide")
"""The families of scenes."""

RANGES = {
    "floor_friction": (0.4, 0.8),
    "payload": (0.0, 4.0),
    "motor_strength": (0.8, 1.0),
    "delay": (0.0, 0.008),
    "sensor_noise": (0.0, 0.5),
}
"""The ranges of `Randomization`, all at once."""

UNITS = {"payload": {"unit": "kg"}, "delay": {"unit": "s"}}

LOAD = ((-0.08, 0.08), (-0.05, 0.05), (0.0, 0.08))
"""Where the payload may be, along each axis of the trunk [m]."""

CAPS = (0.5, 1.7)
"""The caps on the speed [m/s]; the plant's own may be lower than the one requested."""

LEAST_ABLE = 2.5
"""What U does in its weakest direction on the floor of least friction [m/s²]."""

FRIENDLY: dict[str, dict[str, Any]] = {"pd": {}, "pd guided": {"guidance": "geodesic"}}
"""PD with different arguments of the filter."""


@dataclass(frozen=True)
class A1Mixture:
    """Attacked episodes of the A1 on any plant, cap, body, sensors and ground that are covered.

    What a plant declares is drawn in one of three ways. At the *extremes*, every condition is that
    end of its range which is farther from the nominal plant, and the ground is rough. By *ranges*,
    every condition is declared as its whole range, from which the environment draws. Else, each
    condition is, independently, nominal, at that end, or any number of its range.

    Raises:
        InvalidInputError: if a chance is not in [0, 1], or the two shares are more than all.
    """

    extremes: float = 0.1  # share of plants at the extremes
    ranges: float = 0.2  # share of plants that are declared by ranges
    nominal: float = 0.5  # chance that a condition of the other plants is nominal
    # chance that one that is not is at the end of its range; of the payload's place, too
    end: float = 0.5
    rough: float = 0.4  # chance of rough ground, of plants that are not at the extremes
    # chance that the robot knows no more than an estimate, of a preset of sensors
    estimated: float = 0.4
    # chance that the whole robot must stay outside, not the trunk's centre alone
    footprint: float = 0.4
    steps: int = 1000  # the most that an episode takes
    program: str = "lex-cbf-qp"  # of the filter

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.type is float:
                chance = getattr(self, field.name)
                finite_float(f"mixture: {field.name}", chance, minimum=0.0, maximum=1.0)
        if self.extremes + self.ranges > 1.0:
            raise InvalidInputError(
                f"mixture: got the shares {self.extremes} and {self.ranges}, expected at most 1"
            )

    def episode(self, seed: int) -> AttackedEpisode:
        """Return the episode that a seed decides."""
        rng = np.random.default_rng([STREAM, seed])
        name = _one(rng, (*ATTACKS, *FRIENDLY))
        scene = scenarios.make(_one(rng, SCENES), rng)
        low, high = CAPS
        cap = _one(rng, (high, V_MAX, float(rng.uniform(low, high))))
        return AttackedEpisode(
            "pd" if name in FRIENDLY else name,
            replace(scene, v_max=cap).to_dict(),
            seed,
            env_options={"max_episode_steps": self.steps} | self._declared(rng),
            filter_options={"program": self.program} | FRIENDLY.get(name, {}),
        )

    def _declared(self, rng: np.random.Generator) -> dict[str, object]:
        """Return arguments of the environment."""
        way = rng.random()
        extremes = way < self.extremes
        by_ranges = not extremes and way < self.extremes + self.ranges
        ranges: dict[str, object] = {}
        for name, covered in RANGES.items():
            if extremes:
                ranges[name] = _far_end(name)
            elif by_ranges:
                ranges[name] = list(covered)
            elif rng.random() >= self.nominal:
                at_end = rng.random() < self.end
                ranges[name] = _far_end(name) if at_end else float(rng.uniform(*covered))
        cornered = extremes or rng.random() < self.end
        ranges["payload_position"] = [
            float(rng.choice(axis) if cornered else rng.uniform(*axis)) for axis in LOAD
        ]
        estimated = rng.random() < self.estimated
        return {
            "randomization": ranges,
            "terrain": "rough" if extremes or rng.random() < self.rough else "flat",
            "body": "footprint" if rng.random() < self.footprint else "point",
            "estimation": _one(rng, tuple(sensors.PRESETS)) if estimated else None,
        }

    def certifies(self, declared: Mapping[str, object]) -> dict[str, Any]:
        """Return what a plant must declare to be one of these."""
        worst = sensors.PRESETS["uwb"]
        slow = ("rate", "drift_time", "orientation_time", "slip_time")
        bounds = {f.name: "from" if f.name in slow else "to" for f in fields(worst)}
        sensed = {name: {end: getattr(worst, name)} for name, end in bounds.items()}
        place = [{"from": low, "to": high} for low, high in LOAD]
        return {
            "environment": declared["environment"],
            "xml_file": None,
            "feedback": "position",
            "timestep": PHYSICS_DT,
            "gait": "trot",
            "friction": None,
            "terrain": {"any of": ["flat", "rough"]},
            **{
                name: {"from": low, "to": high} | UNITS.get(name, {})
                for name, (low, high) in RANGES.items()
            },
            "payload_position": {
                "any of": [None, {"each": place}],
                "words": f"{', '.join(words(one) for one in place)} m along x, y, z",
            },
            "disturbances": None,
            "estimation": {
                "any of": [None, {"each": sensed}],
                "words": 'None, a preset, or sensors of which none is worse than the preset "uwb" '
                "has",
            },
            "body": {"any of": ["point", "footprint"]},
            "obstacles": 0,
            "input_set": {
                "from": LEAST_ABLE,
                "words": f"at least {LEAST_ABLE} m/s² in every direction, once fitted to the floor",
            },
            "v_max": {"from": CAPS[0], "to": CAPS[1], "unit": "m/s"},
            "scene": {"any of": list(SCENES)},
        }

    @property
    def words(self) -> tuple[str, ...]:
        """What it is, in sentences."""
        low, high = CAPS
        others = 1.0 - self.extremes - self.ranges
        covered = ", ".join(f"{name} {a:g} to {b:g}" for name, (a, b) in RANGES.items())
        place = ", ".join(f"{a:g} to {b:g}" for a, b in LOAD)
        return (
            "The environment is HCBF-A1Regions-v0, with a plant, a cap and a scene of its own in "
            "each episode.",
            f"Conditions: {covered}; the payload's place {place} m.",
            f"Plants: {self.extremes:.0%} have every condition at the end of its range that is "
            f"farther from the nominal plant, and rough ground; {self.ranges:.0%} declare every "
            f"range, and the environment draws from it; of {others:.0%} each condition is nominal "
            f"({self.nominal:.0%}), at that end or uniform (else, {self.end:.0%} and "
            f"{1.0 - self.end:.0%}).",
            f"Ground: rough in {self.rough:.0%} of the plants that are not at the extremes.",
            f"Cap on the speed: {high:g} m/s, {V_MAX:g} m/s, and uniform from {low:g} to {high:g} "
            "m/s, a third each; the environment lowers it to what the declared plant carries.",
            f"State: the truth, or in {self.estimated:.0%} an estimate, by "
            f"{', '.join(sensors.PRESETS)} alike.",
            f"Body: the trunk's centre, or in {self.footprint:.0%} the whole robot.",
            f"Scenes: {', '.join(SCENES)}, alike; each seed draws another one.",
            f"Policies: {', '.join((*ATTACKS, *FRIENDLY))}, alike.",
            f"The filter runs {self.program} on its default rows, with the margins of the plant's "
            f"own law, at most {self.steps} steps.",
            "Entered is what the truth shows at every physics step, of every condition of rank 1, "
            "the speed limit included.",
        )

    @property
    def files(self) -> list[Path]:
        """The user's files that decide the episodes: none."""
        return []


def _far_end(name: str) -> float:
    """Return the end of a condition's range that is farther from the nominal plant."""
    nominal = getattr(Randomization(), name)[0]
    return max(RANGES[name], key=lambda end: abs(end - nominal))


def _one(rng: np.random.Generator, things: Sequence[Any]) -> Any:
    return things[int(rng.integers(len(things)))]
