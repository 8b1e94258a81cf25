"""The A1 with all covered conditions at once, drawn for each episode from its seed.

>>> family = A1Mixture()
>>> family.episode(7) == family.episode(7)
True
>>> print(family.words[0])
The environment is HCBF-A1Regions-v0, with another plant, cap and scene in each episode.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from hcbf_gym import scenarios
from hcbf_gym.certificates.ranges import parse_range
from hcbf_gym.envs.a1_plant import V_MAX
from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.envs.task import PHYSICS_DT
from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.estimation import sensors
from hcbf_gym.evaluation.attacked import AttackedEpisode
from hcbf_gym.evaluation.attacks import ATTACKS

STREAM = 23  # separates the mixture's draws from those of the environment with the same seed
SCENES = ("random", "random-moving", "random-wide")  # the families of scenes

RANGES = {
    "floor_friction": (0.4, 0.8),
    "payload": (0.0, 4.0),
    "motor_strength": (0.8, 1.0),
    "delay": (0.0, 0.008),
    "sensor_noise": (0.0, 0.5),
}
"""The range of each condition of `Randomization`, in its unit."""
UNITS = {"payload": {"unit": "kg"}, "delay": {"unit": "s"}}
PAYLOAD_BOX = ((-0.08, 0.08), (-0.05, 0.05), (0.0, 0.08))
"""The range of the payload's place along each axis of the trunk [m]."""
CAPS = (0.5, 1.7)
"""The range of the requested cap on the speed [m/s]; the plant may lower it."""
LEAST_ACCELERATION = 2.5
"""The acceleration of U in its weakest direction on the floor of least friction [m/s²]."""
FRIENDLY: dict[str, dict[str, Any]] = {"pd": {}, "pd guided": {"guidance": "geodesic"}}
"""Policies that lead to the goal, each with its arguments of the filter."""


@dataclass(frozen=True)
class A1Mixture:
    """Attacked episodes of the A1 on any plant, cap, body, sensors and ground that are covered.

    A plant's conditions are drawn in one of three modes. The *far end* of a condition is the end of
    its range that is farther from the nominal plant.

    - At the *extremes*, every condition is at its far end, and the ground is rough.
    - By *ranges*, every condition is declared as its whole range, from which the environment draws.
    - Else, each condition is independently nominal, at its far end, or uniform in its range.

    Raises:
        InvalidInputError: if a probability is not in [0, 1], or the shares of the first two modes
            exceed 1 together.
    """

    extremes: float = 0.1  # share of plants at the extremes
    ranges: float = 0.2  # share of plants that are declared by ranges
    nominal: float = 0.5  # probability that a condition of the other plants is nominal
    # probability that a condition that is not nominal is at its far end, or the payload in a corner
    end: float = 0.5
    rough: float = 0.4  # probability of rough ground if the plant is not at the extremes
    estimated: float = 0.4  # probability that a preset of sensors estimates the state
    # probability that the whole robot must stay outside instead of the trunk's centre
    footprint: float = 0.4
    steps: int = 1000  # the greatest number of control steps of an episode
    program: str = "lex-cbf-qp"  # of the filter

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.type is float:
                probability = getattr(self, field.name)
                finite_float(f"mixture: {field.name}", probability, minimum=0.0, maximum=1.0)
        if self.extremes + self.ranges > 1.0:
            raise InvalidInputError(
                f"mixture: got the shares {self.extremes} and {self.ranges}, expected at most 1"
            )

    def episode(self, seed: int) -> AttackedEpisode:
        """Return the episode of a seed."""
        rng = np.random.default_rng([STREAM, seed])
        name = _choice(rng, (*ATTACKS, *FRIENDLY))
        scene = scenarios.make(_choice(rng, SCENES), rng)
        low, high = CAPS
        cap = _choice(rng, (high, V_MAX, float(rng.uniform(low, high))))
        return AttackedEpisode(
            "pd" if name in FRIENDLY else name,
            replace(scene, v_max=cap).to_dict(),
            seed,
            env_options={"max_episode_steps": self.steps} | self._plant_options(rng),
            filter_options={"program": self.program} | FRIENDLY.get(name, {}),
        )

    def _plant_options(self, rng: np.random.Generator) -> dict[str, object]:
        """Return random arguments of the environment: conditions, ground, body and sensors."""
        mode = rng.random()
        at_extremes = mode < self.extremes
        by_ranges = not at_extremes and mode < self.extremes + self.ranges
        conditions: dict[str, object] = {}  # a nominal condition is missing
        for name, covered in RANGES.items():
            if at_extremes:
                conditions[name] = _far_end(name)
            elif by_ranges:
                conditions[name] = list(covered)
            elif rng.random() >= self.nominal:
                at_end = rng.random() < self.end
                conditions[name] = _far_end(name) if at_end else float(rng.uniform(*covered))
        in_corner = at_extremes or rng.random() < self.end
        conditions["payload_position"] = [
            float(rng.choice(axis) if in_corner else rng.uniform(*axis)) for axis in PAYLOAD_BOX
        ]
        is_estimated = rng.random() < self.estimated
        return {
            "randomization": conditions,
            "terrain": "rough" if at_extremes or rng.random() < self.rough else "flat",
            "body": "footprint" if rng.random() < self.footprint else "point",
            "estimation": _choice(rng, tuple(sensors.PRESETS)) if is_estimated else None,
        }

    def certifies(self, declared: Mapping[str, object]) -> dict[str, Any]:
        """Return the declarations that a certificate covers; `declared` is the first episode's."""
        worst = sensors.PRESETS["uwb"]
        better_if_greater = ("rate", "drift_time", "orientation_time", "slip_time")
        sensed = {
            field.name: {
                "from" if field.name in better_if_greater else "to": getattr(worst, field.name)
            }
            for field in fields(worst)
        }
        place = [{"from": low, "to": high} for low, high in PAYLOAD_BOX]
        place_words = parse_range({"each": place}, {}).words
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
                "words": f"{place_words} m along x, y, z",
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
                "from": LEAST_ACCELERATION,
                "words": f"at least {LEAST_ACCELERATION} m/s² in every direction, once fitted to "
                "the floor",
            },
            "v_max": {"from": CAPS[0], "to": CAPS[1], "unit": "m/s"},
            "scene": {"any of": list(SCENES)},
        }

    @property
    def words(self) -> tuple[str, ...]:
        """Sentences for the certificate's page that describe the episodes."""
        low, high = CAPS
        others = 1.0 - self.extremes - self.ranges
        covered = ", ".join(f"{name} {a:g} to {b:g}" for name, (a, b) in RANGES.items())
        place = ", ".join(f"{a:g} to {b:g}" for a, b in PAYLOAD_BOX)
        return (
            "The environment is HCBF-A1Regions-v0, with another plant, cap and scene in each "
            "episode.",
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
        """The user's files that decide the episodes; there are none."""
        return []


def _far_end(name: str) -> float:
    """Return the end of a condition's range that is farther from the nominal plant."""
    nominal = getattr(Randomization(), name)[0]
    return max(RANGES[name], key=lambda end: abs(end - nominal))


def _choice(rng: np.random.Generator, options: Sequence[Any]) -> Any:
    """Return one of the options, each with the same probability and with its own type."""
    return options[int(rng.integers(len(options)))]
