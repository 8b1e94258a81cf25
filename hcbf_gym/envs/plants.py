"""What a safety filter must know of this package's environments, as `Plant` records."""

import warnings
from typing import Any

from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.certificates import Judged
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import CoverageWarning
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import EXACT, CoveredBy, Estimate, Plant, Uncertainty
from hcbf_gym.models.reduced_order import DoubleIntegrator


def plant_of(
    env: Any,
    input_set: InputSet | None = None,
    uncertainty: Uncertainty = EXACT,
    on_alarm: str = "warn",
) -> Plant:
    """Return the plant of one of this package's environments, single or native vector.

    Args:
        env: the environment.
        input_set: U; None is the scenario's.
        uncertainty: how far the plant may be from its model.
        on_alarm: what an alarm leads to, "warn" or "brake".
    """
    return Plant(
        model=DoubleIntegrator(),
        barriers=_barriers,
        state=_estimate,
        input_set=env.scenario.input_set if input_set is None else input_set,
        period=CONTROL_DT,
        goal=_goal,
        uncertainty=uncertainty,
        on_alarm=on_alarm,
        covered=_judged,
        declared=_declared,
    )


def _barriers(env: Any, observation: Any, info: dict[str, Any]) -> BarrierSet:
    return env.barrier_set


def _estimate(env: Any, observation: Any, info: dict[str, Any]) -> Estimate:
    return env.estimate


def warn_of(name: str, judged: Judged) -> None:
    """Warn where an environment's arguments are not covered, whatever its scenes are.

    Args:
        name: of the environment.
        judged: what the certificate says that fits it best.
    """
    if not judged.outside:
        return
    if judged.covered_by == CoveredBy.STALE:
        why = f": nothing was tested on {judged.says[0]}"
    else:
        why = f", as the arguments leave what was tested: {'; '.join(judged.says)}"
    warnings.warn(
        f"{name}: rank 1 is not promised (covered = 0){why}", CoverageWarning, stacklevel=5
    )


def _judged(env: Any, observation: Any, info: dict[str, Any]) -> Judged:
    return env.judged


def _declared(env: Any, observation: Any, info: dict[str, Any]) -> Any:
    return env.declared


def _goal(env: Any, observation: Any, info: dict[str, Any]) -> Any:
    return env.goal
