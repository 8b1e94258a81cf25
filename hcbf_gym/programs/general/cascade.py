"""What a plan does stage by stage, for any number of inputs.

It is written in terms of `polyhedron.SolverInputs`, the inputs that the stages so far leave.
The core's `cascade.hpp` is the same for two inputs; the tests hold them together.
"""

from itertools import takewhile

import numpy as np

from hcbf_gym.arrays import Array
from hcbf_gym.programs.general.polyhedron import SolverInputs as Inputs
from hcbf_gym.programs.general.stage_rows import StageRows, in_stages
from hcbf_gym.programs.plans import Plan


def decide(plan: Plan, inputs: Inputs, rows: StageRows, lambda_u: float) -> tuple[Array, Array]:
    """Return u, and the targets (m,) that the rows were drawn to.

    Args:
        plan: what is done.
        inputs: U.
        rows: all rows.
        lambda_u: λ_u.
    """
    if plan.lower == "drawn":
        rows = rows._replace(target=_targets(inputs, rows))
    stages = in_stages(rows)
    u = None
    met = list(takewhile(lambda stage: stage.strict.all(), stages))
    inputs = _meet_in_turn(inputs, met)
    for stage in stages[len(met) :]:
        if stage.strict.all():
            inputs = inputs.meet(stage)
            u = None
        elif plan.lower == "relaxed":
            u = inputs.relax(stage, lambda_u)
        elif plan.lower == "drawn":
            u = inputs.draw(stage, lambda_u)
        if u is not None and plan.lock == "pin":
            inputs = inputs.pin(stage, u)
        elif u is not None and plan.lock == "bound":
            inputs = inputs.bound(stage, u)
    return inputs.nearest() if u is None else u, rows.target


def _targets(inputs: Inputs, rows: StageRows) -> Array:
    """Return ``a_k û_k`` (m,) of the rows that are not strict, and b_k of the others."""
    target = rows.b.copy()
    nominal = inputs.nearest()
    for k in np.flatnonzero(~rows.strict):
        target[k] = rows.a[k] @ nominal
        if target[k] < rows.b[k]:
            target[k] = rows.a[k] @ inputs.meet(rows.only(np.array([k]))).nearest()
    return target


def _meet_in_turn(inputs: Inputs, stages: list[StageRows]) -> Inputs:
    """Meet the strict stages that come first, each as well as those before it allow.

    As many as can be met together are met in one step, and the next one is violated least.
    """
    for count in range(len(stages), 0, -1):
        met = inputs.meeting(*_together(stages[:count]))
        if met is not None:
            break
    else:
        met = inputs
        count = 0
    if count == len(stages):
        return met
    met = met.violating_least(stages[count])
    for stage in stages[count + 1 :]:
        met = met.meet(stage)
    return met


def _together(stages: list[StageRows]) -> tuple[Array, Array]:
    """Return a (s, n_u) and b (s,) of the rows of several stages."""
    return np.concatenate([stage.a for stage in stages]), np.concatenate([s.b for s in stages])
