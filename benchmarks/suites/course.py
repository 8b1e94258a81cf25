"""The paper's course on the A1, as `hcbf evaluate --scenario paper-simulation` walks it."""

from typing import Any

from hcbf_gym import scenarios
from hcbf_gym.barriers.set import Condition
from hcbf_gym.evaluation.comparison import column_names, comparison
from hcbf_gym.evaluation.rollouts import UNFILTERED, Case, aggregate, evaluate
from hcbf_gym.evaluation.tables import Table

SCENARIO = "paper-simulation"
PROGRAMS = (UNFILTERED, "r-cbf-qp", "h-cbf-qp")
QUICK_PROGRAMS = ("h-cbf-qp",)


def run(quick: bool) -> dict[str, Any]:
    """Walk the course under every program; return a row of figures for each."""
    programs = QUICK_PROGRAMS if quick else PROGRAMS
    cases = [Case("HCBF-A1Regions-v0", SCENARIO, "pd", program) for program in programs]
    episodes = {
        case.program: case.label() | {"seed": seed} | episode.summary()
        for case, seed, episode in evaluate(cases, [0])
    }
    return {"rows": aggregate([episodes[program] for program in programs])}


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the table of the README."""
    scene = scenarios.make(SCENARIO)
    rows = [row | {"task": scene.task} for row in figures["rows"]]
    conditions = [Condition(b.name, b.priority) for b in scene.barriers]
    return {"all": comparison(rows, conditions, column_names(rows))}
