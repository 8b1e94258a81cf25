"""The plant that a filter assumes of a walker, by its contract and the declared arguments."""

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

DEPARTURE_MARGIN = 0.02
"""Added to the margin of rows [m] and of the speed limit [m/s] if `Declared.departures` has any."""
DEPARTURE_FACTOR = 2.0
"""Factor on the bounds of the response's error in the same case."""


class Declared(NamedTuple):
    """The declared arguments of `WalkerRegionsEnv`, and the number of boxes in its scene."""

    heading: str | None
    terrain: str
    randomization: Mapping[str, object] | None
    disturbances: Mapping[str, object] | None
    boxes: int  # of the scene
    body: str  # "point" or "footprint"
    v_max: float  # the strict cap on the speed [m/s]

    def plain(self, walker: Walker) -> dict[str, Any]:
        """Return the record by which certificates identify this plant."""
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
        """The differences from a calm, flat floor and the robot of the contract, in words."""
        plant_ranges = dict(self.randomization or {})
        for of_start in ("start_distance", "start_yaw"):
            plant_ranges.pop(of_start, None)
        differences = {
            f"heading {self.heading!r}": self.heading is not None,
            f"terrain {self.terrain!r}": self.terrain != "flat",
            f"randomization {plant_ranges}": Randomization.from_dict(plant_ranges).off_nominal,
            "disturbances": self.disturbances is not None,
            f"{self.boxes} boxes": self.boxes > 0,
        }
        return [words for words, differs in differences.items() if differs]

    @property
    def error_factor(self) -> float:
        """Factor on the bounds of the response's error."""
        return DEPARTURE_FACTOR if self.departures else 1.0


def plant_model(
    walker: Walker, declared: Declared, input_set: InputSet, body: float, is_own: bool
) -> PlantModel:
    """Return the plant that a filter assumes of a walker.

    Its margins are those of a shipped certificate. If none covers the plant, `walker_margins`
    computes them from the robot's response.

    Args:
        walker: the robot.
        declared: the declared arguments.
        input_set: U of the scene.
        body: the robot's reach beyond its trunk's origin [m]; 0 for a point.
        is_own: whether only the robot's motors cap its speed.

    Raises:
        InvalidInputError: if the margin of the speed limit leaves no speed.
    """
    identity = declared.plain(walker)
    response = walker.response or assumed(walker.command)
    nearest = certificates.nearest(identity).despite(response.complaints)
    extra = DEPARTURE_MARGIN if declared.departures else 0.0
    reserved = nearest.margins or margins(response, CONTROL_DT, identity["robot"], extra)
    v_max = speed_row(declared.v_max, reserved.speed, is_own)
    if not is_own:
        warn_of_standing(v_max, reserved, response)
    axle = axle_of(walker.command, response, input_set, declared.v_max)
    reachable = braked(input_set, response)
    braking = None if axle else stops(response, declared.v_max, reachable)
    uncertainty = reserved._replace(body=body)
    return PlantModel(reachable, v_max, uncertainty, identity, nearest, axle, braking)
