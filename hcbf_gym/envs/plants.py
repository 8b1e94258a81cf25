"""What a safety filter must know of this package's environments, as `Plant` records."""

from functools import partial
from typing import Any, NamedTuple

from hcbf_gym.certificates import Judged, NearestCertificate, warn_of_version
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.errors import CoverageWarning, warn_caller
from hcbf_gym.models.axle import Axle
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import EXACT, CoveredBy, Plant, Uncertainty
from hcbf_gym.models.reduced_order import DoubleIntegrator


def _read(name: str, env: object, *_: object) -> Any:
    """Return what an environment says of itself, as a plant's reader."""
    return getattr(env, name)


_GOAL, _JUDGED, _DECLARED = (partial(_read, name) for name in ("goal", "judged", "declared"))
# the same readers for every plant: filters compare them


def _barriers(env: Any, *_: object) -> Any:
    """Return an environment's barriers; asked for at every step."""
    return env.barrier_set


def _estimate(env: Any, *_: object) -> Any:
    """Return what an environment knows of its state; asked for at every step."""
    return env.estimate


READERS = _barriers, _estimate, _GOAL, _JUDGED
"""They look at the environment alone, neither at observations nor at infos."""


class PlantModel(NamedTuple):
    """What a filter takes for true of a simulated robot, from its environment's arguments.

    Attributes:
        input_set: U, as the robot carries it.
        v_max: the strict cap on the speed [m/s].
        uncertainty: how far the robot may be from its reduced-order model.
        declared: the arguments, as certificates compare them.
        nearest: the shipped certificate that fits them best.
        axle: what limits a differential drive; None for all others.
        braking: with how much its body stops [m/s²]; None for what U can do.
    """

    input_set: InputSet
    v_max: float
    uncertainty: Uncertainty
    declared: dict[str, Any]
    nearest: NearestCertificate
    axle: Axle | None = None
    braking: float | None = None


def plant_of(
    input_set: InputSet,
    uncertainty: Uncertainty = EXACT,
    on_alarm: str = "warn",
    axle: Axle | None = None,
    braking: float | None = None,
) -> Plant:
    """Return the plant of one of this package's environments, single or native vector.

    Args:
        input_set: U.
        uncertainty: how far the plant may be from its model.
        on_alarm: what an alarm leads to, "warn" or "brake".
        axle: what limits a differential drive; None for all others.
        braking: with how much the body stops [m/s²]; None for what U can do.
    """
    return Plant(
        model=DoubleIntegrator(),
        barriers=_barriers,
        state=_estimate,
        input_set=input_set,
        period=CONTROL_DT,
        goal=_GOAL,
        uncertainty=uncertainty,
        on_alarm=on_alarm,
        axle=axle,
        braking=braking,
        covered=_JUDGED,
        declared=_DECLARED,
    )


def warn_of(name: str, judged: Judged) -> None:
    """Warn where an environment's arguments are not covered, whatever its scenes are.

    Args:
        name: of the environment.
        judged: what the certificate says that fits it best.
    """
    if not judged.outside:
        return
    if judged.covered_by == CoveredBy.VERSION:
        warn_of_version(judged.reasons[0])
        return
    warn_caller(
        f"{name}: rank 1 is not promised (covered = 0), as the arguments leave what was tested: "
        f"{'; '.join(judged.reasons)}",
        CoverageWarning,
    )
