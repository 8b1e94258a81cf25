"""What a filter believes of a walker, from its contract and from what is declared."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.robots.walker import NAMES, Walker
from hcbf_gym.robots.walker_response import UNKNOWN, uncertainty
from hcbf_gym.scenarios import Scenario

OFF_NOMINAL = 0.02
"""What rows reserve besides [m], and the speed limit's [m/s], where the arguments declare anything
but the contract's robot on a flat and calm floor."""


TESTED: tuple[str, ...] = ()
"""Names of the package's own walkers that hostile episodes tested at length; none yet."""


class Declared(NamedTuple):
    """What the arguments of `WalkerRegionsEnv` declare.

    Attributes:
        heading: as the environment takes it.
        terrain: as the environment takes it.
        randomization: the plant's ranges.
        disturbances: as the environment takes it.
        boxes: how many the scene has.
    """

    heading: str | None
    terrain: str
    randomization: Mapping[str, Any] | None
    disturbances: Mapping[str, Any] | None
    boxes: int

    @property
    def departures(self) -> list[str]:
        """What differs from a calm, flat floor and the robot of the contract, a phrase for each."""
        ranges = {} if self.randomization is None else dict(self.randomization)
        start = ("start_distance", "start_yaw")
        plant = {name: value for name, value in ranges.items() if name not in start}
        told = {
            f"heading {self.heading!r}": self.heading is not None,
            f"terrain {self.terrain!r}": self.terrain != "flat",
            f"randomization {plant}": Randomization.from_dict(plant).off_nominal,
            "disturbances": self.disturbances is not None,
            f"{self.boxes} boxes": self.boxes > 0,
        }
        return [name for name, differs in told.items() if differs]


def outside(walker: Walker, declared: Declared) -> list[str]:
    """Return why the promise was not tested, a phrase for each reason; empty where it was.

    Hostile episodes tested the robots of `TESTED` on a flat and calm floor.
    """
    said = []
    if walker.source not in [NAMES[name] for name in TESTED]:
        said.append(f"robot {walker.name!r} (tested: {', '.join(TESTED) or 'none'})")
    if walker.response is None:
        said.append("a robot that was not measured: hcbf identify does that")
    return said + [f"{departure} (tested: none)" for departure in declared.departures]


def speed_cap(walker: Walker, scenario: Scenario, v_max: float | None) -> float:
    """Return the strict cap on the speed [m/s]: the scene's, the user's, or the contract's.

    Raises:
        InvalidInputError: if it is more than the contract's forward speed.
    """
    most = walker.command.forward
    asked = scenario.v_max if v_max is None else v_max
    cap = most if asked is None else finite_float("v_max", asked, minimum=0.0, exclusive=True)
    if cap > most:
        raise InvalidInputError(
            f"v_max: got {cap} m/s, expected at most {most} for the walker {walker.name!r}"
        )
    return cap


def uncertainty_of(
    walker: Walker, period: float, declared: Declared, body: float, v_max: float
) -> Uncertainty:
    """Return how far the robot may be from its reduced-order model.

    Args:
        walker: the robot.
        period: between two inputs [s].
        declared: what else is declared.
        body: what the robot reaches beyond the point that follows [m]; 0 for a point.
        v_max: the strict cap on the speed [m/s].

    Raises:
        InvalidInputError: if the margin of the speed limit leaves no speed.
    """
    response = UNKNOWN if walker.response is None else walker.response
    known = uncertainty(response, period)._replace(body=body)
    if declared.departures:
        known = known._replace(
            distance=known.distance + OFF_NOMINAL, speed=known.speed + OFF_NOMINAL
        )
    if v_max <= 2.0 * known.speed:
        raise InvalidInputError(
            f"v_max: got {v_max} m/s, expected above {2.0 * known.speed:g} m/s: the row of the "
            f"speed limit reserves {known.speed:g} m/s, so that no speed is left"
        )
    return known
