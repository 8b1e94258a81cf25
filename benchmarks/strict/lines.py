"""The lines of the strict suite: who attacks which plant, in which scenes, how often."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import count, islice
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import scenarios
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.envs.a1_plant import FASTEST, V_MAX
from hcbf_gym.evaluation.attacked import AttackedEpisode
from hcbf_gym.evaluation.attacks import ATTACKS
from hcbf_gym.policies import learned

FIRST_SEED = {"random": 50_000, "random-moving": 60_000, "random-wide": 70_000}
"""Of each family: with the same seed the first two have the same strict regions."""

AIMED = ("nearest", "corner", "edge")  # The attacks that came closest

FAST = ("bang-bang", "rotating", "edge", "slam")
"""The attacks that use the speed that a high cap leaves them."""

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
"""Plants that differ from the models of the filter and the controller."""

FIX: dict[str, Any] = {"estimation": {}}  # A position fix of 2 cm at 20 Hz, 40 ms late
BODY: dict[str, Any] = {"body": "footprint"}
GUIDED: dict[str, Any] = {"guidance": "geodesic"}


class Line(NamedTuple):
    """One line of the tables."""

    section: str  # what is varied
    name: str  # how
    policies: tuple[str, ...]  # hostile or not, `scenarios` for each of them
    seeds: int  # how many for each policy and scenario
    scenarios: tuple[str, ...] = ("random",)  # names of random ones
    env_options: Mapping[str, Any] | None = None  # further arguments of the environment
    filter_options: Mapping[str, Any] | None = None  # arguments of `SafetyFilter`
    calm: bool = False  # take scenes alone that do not start in a conflict
    v_max: float | None = None  # the strict cap on the speed [m/s] in the place of the scenes' own

    def episodes(self, quick: bool) -> list[AttackedEpisode]:
        """Return its episodes; with `quick` one for each policy and scenario, two seconds long."""
        shorter = {"max_episode_steps": 100} if quick else {}
        return [
            AttackedEpisode(
                policy,
                scenario if self.v_max is None else faster(scenario, seed, self.v_max),
                seed,
                env_options=dict(self.env_options or {}) | shorter,
                filter_options=self.filter_options,
            )
            for policy in self.policies
            for scenario in self.scenarios
            for seed in seeds(scenario, 1 if quick else self.seeds, self.calm)
        ]


def seeds(scenario: str, number: int, calm: bool) -> list[int]:
    """Return the first seeds of a random scenario."""
    every = count(FIRST_SEED[scenario])
    taken = (seed for seed in every if not calm or start_is_free(scenario, seed))
    return list(islice(taken, number))


def faster(scenario: str, seed: int, v_max: float) -> dict[str, Any]:
    """Return the scene that an environment draws with this seed, with another cap on the speed."""
    scene = scenarios.make(scenario, np.random.default_rng(seed))
    return replace(scene, v_max=v_max).to_dict()


def start_is_free(scenario: str, seed: int) -> bool:
    """Return whether the scene that an environment draws with this seed starts in no region."""
    scene = scenarios.make(scenario, np.random.default_rng(seed))
    start = np.array([[*scene.start, 0.0, 0.0]])
    return bool((BarrierSet([scene.barriers]).values(start, np.zeros(1)) >= 0.0).all())


BOTH = ("random", "random-moving")

LINES = (  # Every attack on the nominal plant, the aimed ones on others, and friendly policies
    *(Line("nominal", name, (name,), 150, BOTH) for name in ATTACKS),
    *(Line("cap", f"{v_max} m/s", FAST, 75, v_max=v_max) for v_max in (V_MAX, FASTEST)),
    Line("policy", "pd", ("pd",), 300),
    *(Line("plant", name, AIMED, 100, env_options=options) for name, options in PLANTS.items()),
    Line("estimate", "20 Hz, 2 cm, 40 ms", AIMED, 50, BOTH, FIX),
    Line("estimate", "pd", ("pd",), 300, env_options=FIX),
    Line("body", "attacks, random", tuple(ATTACKS), 38, env_options=BODY),
    Line("body", "attacks, random-wide", tuple(ATTACKS), 38, ("random-wide",), BODY),
    Line("body", "pd, guided, random-wide", ("pd",), 300, ("random-wide",), BODY, GUIDED),
    *(
        Line("rank 2", name, (name,), 300, calm=True, filter_options={"program": "lex-cbf-qp"})
        for name in ("pd", *learned.names())
    ),
)
