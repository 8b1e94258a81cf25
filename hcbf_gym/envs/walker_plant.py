"""What a filter believes of a walker, from its contract and from what is declared."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from hcbf_gym import certificates, records
from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.errors import InvalidInputError, finite_float
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.robots.walker import Walker
from hcbf_gym.robots.walker_response import UNKNOWN, uncertainty
from hcbf_gym.scenarios import Scenario

OFF_NOMINAL = 0.02
"""What rows reserve besides [m], and the speed limit's [m/s], where the arguments declare anything
but the contract's robot on a flat and calm floor."""

WIDENED = 2.0
"""Of the bounds of what the robot does beside what it is told, there as well."""


class Declared(NamedTuple):
    """What the arguments of `WalkerRegionsEnv` declare.

    Attributes:
        heading: as the environment takes it.
        terrain: as the environment takes it.
        randomization: the plant's ranges.
        disturbances: as the environment takes it.
        boxes: how many the scene has.
        body: as the environment takes it.
        v_max: the strict cap on the speed [m/s].
    """

    heading: str | None
    terrain: str
    randomization: Mapping[str, Any] | None
    disturbances: Mapping[str, Any] | None
    boxes: int
    body: str
    v_max: float

    def told(self, walker: Walker) -> dict[str, Any]:
        """Return what tells this plant from others, as certificates compare it."""
        robot = certificates.robot_of(walker.name, walker.files)
        said = {"environment": "HCBF-WalkerRegions-v0", "robot": robot, "v_max": self.v_max}
        return records.plain(said | {"body": self.body, "departures": self.departures})

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


def widened(declared: Declared) -> float:
    """Return by how much a robot may do otherwise than it was measured: what is declared does."""
    return WIDENED if declared.departures else 1.0


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
    found: certificates.NearestCertificate,
    walker: Walker,
    period: float,
    declared: Declared,
    body: float,
) -> Uncertainty:
    """Return how far the robot may be from its reduced-order model.

    A shipped certificate says it; where none speaks of the plant, what `identify` measured does,
    and no less than a certificate of the same robot on another plant.

    Args:
        found: the shipped certificate that fits best.
        walker: the robot.
        period: between two inputs [s].
        declared: what else is declared.
        body: what the robot reaches beyond the point that follows [m]; 0 for a point.

    Raises:
        InvalidInputError: if the margin of the speed limit leaves no speed.
    """
    if found.margins is not None:
        known = found.margins._replace(body=body)
    else:
        response = UNKNOWN if walker.response is None else walker.response
        more = OFF_NOMINAL if declared.departures else 0.0
        known = uncertainty(response, period)._replace(body=body)
        known = known._replace(distance=known.distance + more, speed=known.speed + more)
        known = certificates.at_least(known, certificates.robot_of(walker.name, walker.files))
    v_max = declared.v_max
    if v_max <= 2.0 * known.speed:
        raise InvalidInputError(
            f"v_max: got {v_max} m/s, expected above {2.0 * known.speed:g} m/s: the row of the "
            f"speed limit reserves {known.speed:g} m/s, so that no speed is left"
        )
    return known
