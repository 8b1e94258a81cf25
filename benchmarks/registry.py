"""Every suite of figures: where it is, what it depends on, how long it takes.

A suite is a module with ``run(quick) -> figures``, figures of JSON types, and ``tables(figures) ->
{name: Table}``, or with ``PARTS`` that make a table each. Registering one is a line in `SUITES`.
"""

import importlib
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.common import run_parts
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.sources import sources_hash

_ROOT = Path(__file__).parents[1]

ROM = ("hcbf_gym/envs/regions.py", "hcbf_gym/envs/regions_vector.py")
"""What the reduced-order environments are made of, and through their imports all below them."""
A1 = ("hcbf_gym/envs/a1_regions.py", "hcbf_gym/robots/a1/a1.xml")  # The same of the walking robot
BASELINES = ("hcbf_gym/policies/baselines/*",)  # The policies that come with the package


class Suite(NamedTuple):
    """One suite."""

    module: str  # below `benchmarks`
    does: str  # one line
    minutes: float  # what a full run takes on two cores
    # patterns of files of the checkout that it depends on without importing them
    also: tuple[str, ...] = ()
    extra: str = ""  # the extra that it needs, if any
    needs: tuple[str, ...] = ()  # the modules of that extra that must be there

    def run(self, quick: bool) -> dict[str, Any]:
        """Return its figures."""
        module = importlib.import_module(f"benchmarks.{self.module}")
        return module.run(quick) if hasattr(module, "run") else run_parts(module.PARTS, quick)

    def tables(self, figures: dict[str, Any]) -> dict[str, Table]:
        """Return the tables of its figures by name; those of parts are stored as they are."""
        module = importlib.import_module(f"benchmarks.{self.module}")
        if hasattr(module, "tables"):
            return module.tables(figures)
        return {name: Table(**one) for name, one in figures.items()}

    def sources(self) -> str:
        """Return the hash of the sources that its figures depend on."""
        own = _ROOT.joinpath("benchmarks", *self.module.split(".")).with_suffix(".py")
        also = [file for p in self.also for file in _ROOT.glob(p) if file.is_file()]
        return sources_hash([own, *also])


SUITES = {  # name → suite; `python -m benchmarks --suite NAME`, ``docs/results/NAME.json``
    "course": Suite("suites.course", "the paper's course on the A1", 1, A1),
    "reproduction": Suite(
        "suites.reproduction",
        "the paper's figures drawn anew, and its claims",
        1,
        (*ROM, *A1, "hcbf_gym/evaluation/rollouts.py"),
        extra="studies",
        needs=("optuna",),
    ),
    "filter": Suite(
        "suites.filter",
        "what SafetyFilter adds to a step, beside cbfpy",
        1,
        ROM,
        extra="benchmark",
        needs=("cbfpy", "elastiqp"),
    ),
    "monitor": Suite("suites.monitor", "are wrappers between filter and robot noticed?", 2, A1),
    "strict": Suite(
        "strict.suite",
        "attacks, search and pushes against the strict rank",
        60,
        (*A1, *BASELINES),
        extra="studies",
        needs=("optuna", "cmaes"),
    ),
    "soak": Suite(
        "suites.soak", "memory over an hour of simulated time, with resets and faults", 3, A1
    ),
    "programs": Suite("suites.programs", "time of each filter, beside cbfpy", 1),
    "verify-programs": Suite("suites.verify_programs", "each filter against exact solutions", 40),
    "start-up": Suite("suites.start_up", "first starts and installation", 5, (*ROM, *A1)),
    "environments": Suite("suites.environments", "environment steps per second", 3, ROM),
    "monte-carlo": Suite(
        "suites.monte_carlo", "programs in random conflicting scenes, by priority", 1
    ),
    "learned-policies": Suite(
        "suites.learned_policies",
        "success and safety of policies under every program",
        5,
        (*ROM, *BASELINES),
    ),
    "policies-on-a1": Suite(
        "suites.policies_on_a1", "the same policies on the A1", 35, (*A1, *BASELINES)
    ),
    "locomotion": Suite("suites.locomotion", "quality, robustness and speed of the walk", 2, A1),
    "guidance": Suite(
        "suites.guidance", "who arrives under a strict filter", 15, (*ROM, *BASELINES)
    ),
    "map-guidance": Suite(
        "map_guidance",
        "guidance on maps: who arrives, corridors, out of zones",
        2,
        (*ROM, "hcbf_robots/envs/walker_regions.py", "hcbf_robots/carts/*"),
    ),
    "held-rows": Suite(
        "suites.held_rows", "held rows under friendly and hostile policies, without margin", 4, ROM
    ),
    "estimation": Suite("suites.estimation", "how well the A1 knows where it is", 2, A1),
    "foreign": Suite(
        "suites.foreign",
        "foreign environments and models behind the filter",
        10,
        extra="examples",
        needs=("gymnasium_robotics", "jax", "stable_baselines3"),
    ),
    "walkers": Suite(
        "walkers",
        "robots that take velocities: attacked, towards goals, how they follow",
        40,
        ("hcbf_robots/envs/walker_regions.py", "hcbf_robots/carts/*", "tests/robots/contracts/*"),
        extra="walkers",
        needs=("onnxruntime",),
    ),
    "maps": Suite(
        "maps",
        "maps: exact covers, attacks, speed zones, walkers",
        15,
        (*ROM, *A1, "hcbf_robots/envs/walker_regions.py", "hcbf_robots/maps/plans/*"),
        extra="walkers",
        needs=("onnxruntime",),
    ),
    "ground-truth": Suite(
        "ground_truth.suite",
        "filters beside the exact kernel: what they change and miss",
        6,
        extra="ground-truth",
        needs=("cbfpy", "elastiqp", "hj_reachability"),
    ),
    "crossing": Suite(
        "suites.crossing", "regions faster than the robot, known and hidden speeds", 8, ROM
    ),
    "mutations": Suite("suites.mutations", "malformed inputs: refused clearly, or sensible", 1, A1),
}
