"""The A1 in everything that is called covered at once, drawn for each episode from its seed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hcbf_gym import scenarios
from hcbf_gym.envs import coverage
from hcbf_gym.estimation import sensors
from hcbf_gym.evaluation.attacked import AttackedEpisode
from hcbf_gym.evaluation.attacks import ATTACKS

STREAM = 23
"""Sets the draws of the mixture apart from those that the environment makes with the same seed."""

EXTREMES, RANGES, ONE_BY_ONE = "extremes", "ranges", "one by one"
"""How a plant is declared; see `A1Mixture`."""


@dataclass(frozen=True)
class A1Mixture:
    """Episodes of the A1 on any plant, cap, body, sensor and ground that `coverage` calls covered.

    A plant of "extremes" has everything at the end of its range that differs most from the nominal
    plant; of "ranges" everything is declared as its whole range, and the environment draws from it;
    "one by one" each of them is nominal, at that end, or a number drawn from the range.

    Args:
        policies: attacks, and policies of which those in `guided` have guidance in the filter.
        guided: "pd guided" is PD with guidance.
        scenes: families of random scenes.
        plants: how plants are declared, with the share of each.
        nominal: chance that something is nominal, where plants are drawn one by one.
        extreme: chance that what is not nominal lies at the end of its range.
        rough: chance of rough ground.
        caps: caps on the speed of which one is drawn [m/s], or (the last third) any between them.
        estimated: chance that the robot knows an estimate alone, by one of the presets.
        footprint: chance that the whole robot must stay outside.
    """

    policies: tuple[str, ...] = (*ATTACKS, "pd", "pd guided")
    scenes: tuple[str, ...] = coverage.SCENES
    plants: tuple[tuple[str, float], ...] = ((EXTREMES, 0.1), (RANGES, 0.2), (ONE_BY_ONE, 0.7))
    nominal: float = 0.5
    extreme: float = 0.5
    rough: float = 0.4
    estimated: float = 0.4
    footprint: float = 0.4

    def episode(self, seed: int) -> AttackedEpisode:
        """Return the episode that a seed decides."""
        rng = np.random.default_rng([STREAM, seed])
        policy, scene = _one(rng, self.policies), _one(rng, self.scenes)
        names, shares = zip(*self.plants, strict=True)
        plant = str(rng.choice(names, p=shares))
        low, high = coverage.CAPS
        cap = _one(rng, (high, 1.5, float(rng.uniform(low, high))))
        drawn = scenarios.make(scene, rng)
        options: dict[str, Any] = {
            "randomization": self._plant(plant, rng),
            "terrain": "rough" if plant == EXTREMES or rng.random() < self.rough else "flat",
            "body": "footprint" if rng.random() < self.footprint else "point",
        }
        if rng.random() < self.estimated:
            options["estimation"] = _one(rng, tuple(sensors.PRESETS))
        guided = policy == "pd guided"
        return AttackedEpisode(
            "pd" if guided else policy,
            replace(drawn, v_max=cap).to_dict(),
            seed,
            env_options=options,
            filter_options={"guidance": "geodesic"} if guided else None,
        )

    def _plant(self, kind: str, rng: np.random.Generator) -> dict[str, Any]:
        declared: dict[str, Any] = {}
        for name, (low, high) in coverage.RANGES.items():
            nominal = getattr(coverage.NOMINAL, name)[0]
            end = max((low, high), key=lambda value: abs(value - nominal))
            number = end if rng.random() < self.extreme else float(rng.uniform(low, high))
            if kind == EXTREMES:
                declared[name] = end
            elif kind == RANGES:
                declared[name] = [low, high]
            elif rng.random() >= self.nominal:
                declared[name] = number
        at_ends = kind == EXTREMES or rng.random() < self.extreme
        declared["payload_position"] = [
            float(rng.choice(ends) if at_ends else rng.uniform(*ends)) for ends in coverage.LOAD
        ]
        return declared


def _one(rng: np.random.Generator, things: Sequence[Any]) -> Any:
    return things[rng.integers(len(things))]
