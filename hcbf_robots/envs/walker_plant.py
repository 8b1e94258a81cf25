"""What a filter assumes of a walker, from its contract and from what is declared."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from hcbf_gym import certificates, records
from hcbf_gym.envs.plants import PlantModel
from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.envs.task import CONTROL_DT
from hcbf_gym.models.input_sets import InputSet
from hcbf_robots.walkers.walker import Walker
from hcbf_robots.walkers.walker_margins import (
    axle_of,
    braked,
    margins,
    speed_row,
    stops,
    warn_of_standing,
)
from hcbf_robots.walkers.walker_response import assumed

OFF_NOMINAL = 0.02
"""Added to the margin of rows [m], and of the speed limit [m/s], where the arguments declare
anything but the contract's robot on a flat and calm floor."""

WIDENED = 2.0
"""Factor on the bounds of the response's error there."""


class Declared(NamedTuple):
    """What the arguments of `WalkerRegionsEnv` declare, and how many boxes the scene has."""

    heading: str | None
    terrain: str
    randomization: Mapping[str, object] | None
    disturbances: Mapping[str, object] | None
    boxes: int
    body: str
    v_max: float

    def plain(self, walker: Walker) -> dict[str, Any]:
        """Return what identifies this plant, as certificates compare it."""
        robot = certificates.robot_of(walker.name, walker.files)
        return records.plain({
            "environment": "HCBF-WalkerRegions-v0",
            "robot": robot,
            "v_max": self.v_max,
            "body": self.body,
            "departures": self.departures,
        })  # fmt: skip

    @property
    def departures(self) -> list[str]:
        """The differences from a calm, flat floor and the robot of the contract, as phrases."""
        ranges = {} if self.randomization is None else dict(self.randomization)
        start = ("start_distance", "start_yaw")
        plant = {name: value for name, value in ranges.items() if name not in start}
        phrases = {
            f"heading {self.heading!r}": self.heading is not None,
            f"terrain {self.terrain!r}": self.terrain != "flat",
            f"randomization {plant}": Randomization.from_dict(plant).off_nominal,
            "disturbances": self.disturbances is not None,
            f"{self.boxes} boxes": self.boxes > 0,
        }
        return [name for name, differs in phrases.items() if differs]


def widened(declared: Declared) -> float:
    """Return the factor on the bounds of the response's error."""
    return WIDENED if declared.departures else 1.0


def plant_model(
    walker: Walker, declared: Declared, input_set: InputSet, body: float, is_own: bool
) -> PlantModel:
    """Return what a filter assumes of a walker.

    A shipped certificate has the distance of the robot from its reduced-order model; where none
    holds of the plant, `walker_margins` computes it.

    Args:
        walker: the robot.
        declared: what the arguments declare.
        input_set: U of the scene.
        body: the robot's reach beyond its trunk's origin [m]; 0 for a point.
        is_own: whether nothing but the robot's motors caps its speed.

    Raises:
        InvalidInputError: if the margin of the speed limit leaves no speed.
    """
    stated = declared.plain(walker)
    response = walker.response or assumed(walker.command)
    found = certificates.nearest(stated).despite(response.complaints)
    more = OFF_NOMINAL if declared.departures else 0.0
    known = found.margins or margins(response, CONTROL_DT, stated["robot"], more)
    row = speed_row(declared.v_max, known.speed, is_own)
    if not is_own:
        warn_of_standing(row, known, response)
    axle = axle_of(walker.command, response, input_set, declared.v_max)
    known, able = known._replace(body=body), braked(input_set, response)
    stopping = None if axle else stops(response, declared.v_max, able)
    return PlantModel(able, row, known, stated, found, axle, stopping)
