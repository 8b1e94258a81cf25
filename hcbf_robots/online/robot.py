"""The robot that a velocity filter takes, and the reduced-order plant that the robot follows."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from numpy.typing import ArrayLike

from hcbf_gym import certificates
from hcbf_gym.barriers import SpeedLimit, braking
from hcbf_gym.barriers.class_k import LogClassK
from hcbf_gym.errors import (
    CoverageWarning,
    InvalidInputError,
    finite_float,
    require_packages,
    shown,
    text,
    warn_caller,
)
from hcbf_gym.models.input_sets import Box, InputSet
from hcbf_gym.models.plant import Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator
from hcbf_robots.walkers import footprint as footprints
from hcbf_robots.walkers import walker_margins
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import Response, assumed

if TYPE_CHECKING:
    from hcbf_gym.certificates import Certificate

LARGEST_INPUT = 5.0
"""Bound of each component of U, as in the paper; the robot's own braking may reduce U [m/s²]."""
DEFAULT_ALPHA1_UP_TO = 1.5
"""Greatest speed up to which the filter's default α₁ is used [m/s]."""


@dataclass(frozen=True)
class Robot:
    """A robot without a contract.

    Args:
        command: the velocities that it may be commanded.
        response: how it follows; None assumes a slow robot that oscillates, see
            `walker_response.assumed`.
        reach: radius of the circle around its centre, or a cart's axle, that holds it [m]; with 0,
            and no footprint, the robot is a point.
        footprint: its outline, as Nav2 writes it, see `walkers.footprint.reach`: `reach` becomes
            no less than holds it.
        known_as: its name in certificates; "" for none.
    """

    command: Command
    response: Response | None = None
    reach: float = 0.0
    footprint: str | ArrayLike | None = None
    known_as: str = ""

    def __post_init__(self) -> None:
        for name, kind in (("command", Command), ("response", Response)):
            value = getattr(self, name)
            if not isinstance(value, kind) and (name == "command" or value is not None):
                raise InvalidInputError(
                    f"robot: {name}: got {shown(value)}, expected a {kind.__name__}"
                )
        object.__setattr__(self, "known_as", text("robot: known_as", self.known_as))
        if self.response is not None:
            self.response.gains(len(self.command.limits))  # raises for another robot's response
        reach = finite_float("robot: reach", self.reach, minimum=0.0)
        if self.footprint is not None:
            object.__setattr__(self, "reach", max(reach, footprints.reach(self.footprint)))


def known_of(robot: object) -> Robot:
    """Return the `Robot` of a contract's path or name, of a `Walker`, or a `Robot` as it is.

    Raises:
        InvalidInputError: if it is none of them.
    """
    if isinstance(robot, Robot):
        return robot
    require_packages("a robot's contract, other than hcbf_robots.Robot(…),", "mujoco")
    from hcbf_robots.walkers.walker import Walker

    if isinstance(robot, str | Path):
        robot = Walker.load(robot)
    if not isinstance(robot, Walker):
        raise InvalidInputError(
            f"robot: got {shown(robot)}, expected a contract's path or name, a Walker or a Robot"
        )
    known_as = certificates.robot_of(robot.name, robot.files)
    return Robot(robot.command, robot.response, robot.reach, known_as=known_as)


class SpeedCap(NamedTuple):
    """A cap on the speed, and the speeds that it permits."""

    limits: tuple[SpeedLimit, ...]  # the condition; empty without a cap
    begins_at: float  # the greatest speed at which the model restarts [m/s]
    fastest: float  # the greatest commanded speed [m/s]


class VelocityPlant(NamedTuple):
    """The double integrator that a robot follows by its centre, or a point before its axle."""

    plant: Plant
    input_set: InputSet  # U, as the response of the robot leaves it [m/s²]
    robot: Robot
    response: Response  # as measured, or assumed of an unmeasured robot

    @property
    def max_deceleration(self) -> float:
        """The greatest acceleration along the motion [m/s²]."""
        axle = self.plant.axle
        return self.input_set.radius if axle is None else axle.braking

    @property
    def max_acceleration(self) -> float:
        """The greatest acceleration of the centre, or of the point before the axle [m/s²]."""
        axle = self.plant.axle
        return self.input_set.radius if axle is None else axle.hardest_of_point

    def speed_cap(self, v_max: float | None, period: float) -> SpeedCap:
        """Return a strict cap `v_max` [m/s], or none but the greatest command, at a period T [s].

        Raises:
            InvalidInputError: if it is above the greatest command, leaves no speed after its
                margin, or is passed within one period at full input.
        """
        most, reserved = self.robot.command.fastest, self.plant.uncertainty
        if v_max is None:
            return SpeedCap((), most, most)
        cap = finite_float("v_max", v_max, minimum=0.0, exclusive=True)
        if not 2.0 * reserved.speed < cap <= most:
            raise self._cap_error(cap)
        left = float(braking.speed_left(cap, reserved.speed))
        gained = period * self.max_deceleration
        if left <= gained:
            raise InvalidInputError(
                f"v_max: got {cap:g} m/s, which leaves {left:.3g} m/s after its margin, expected "
                f"above {gained:.3g} m/s, which an input reaches within one period: sample faster, "
                f"or leave v_max out and command no more: Command(forward={cap:g}, …)"
            )
        walker_margins.warn_of_standing(cap, reserved, self.response)
        limits = (SpeedLimit("speed limit", 1, cap),)
        return SpeedCap(limits, left, math.sqrt(left**2 - gained**2))

    def _cap_error(self, cap: float) -> InvalidInputError:
        """Return the error of a cap [m/s] that is too low or too high, with its remedy."""
        least, most = 2.0 * self.plant.uncertainty.speed, self.robot.command.fastest
        measured = self.robot.response is not None
        remedy = "" if measured else ", or measure how it follows by hcbf identify --log drive.csv"
        return InvalidInputError(
            f"v_max: got {cap:g} m/s, expected above {least:.3g} m/s, twice what its row reserves "
            f"for the overshoot of {'a' if measured else 'an unmeasured'} robot, and at most "
            f"{most:g} m/s, the greatest command; leave v_max out where the robot's motors cap its "
            f"speed, or command no more: Command(forward={min(cap, most):g}, …){remedy}"
        )


def plant_of(
    robot: Robot,
    period: float,
    radius: float | None,
    max_age: float,
    certificate: "str | Path | Certificate | None",
) -> VelocityPlant:
    """Return the plant of a robot; its arguments are those of `VelocityFilter`."""
    response = robot.response or assumed(robot.command)
    if response.complaints:
        warn_caller(
            "velocity filter: rank 1 is not promised (covered = 0), as the robot does not "
            f"follow: {'; '.join(response.complaints)}",
            CoverageWarning,
        )
    if robot.response:
        walker_margins.warn_of_lateness(robot.command, robot.response)
    reserved = walker_margins.margins(response, period, robot.known_as)
    if certificate is not None:
        reserved = certificates.load(certificate).margins or reserved
    body = finite_float("radius", robot.reach if radius is None else radius, minimum=0.0)
    fastest, largest_set = robot.command.fastest, Box.symmetric(LARGEST_INPUT)
    input_set = walker_margins.braked(largest_set, response)
    axle = walker_margins.axle_of(robot.command, response, largest_set, robot.command.forward)
    plant = Plant(
        DoubleIntegrator(), _no_reader, _no_reader, input_set, period=period,
        uncertainty=reserved._replace(body=body), axle=axle, max_age=max_age,
        braking=None if axle else walker_margins.stops(response, fastest, input_set),
        fastest=None if axle else fastest,
    )  # fmt: skip
    return VelocityPlant(plant, input_set, robot, response)


def alpha1_of(fastest: float) -> LogClassK:
    """Return α₁ for a robot of a greatest speed [m/s].

    For a fast robot φ₁ grows with the speed, while the slope at 0 remains. With the default φ₁,
    α₁⁻¹, and with it the distance that the robot must see, would grow exponentially.
    """
    default = LogClassK()
    factor = max(1.0, fastest / DEFAULT_ALPHA1_UP_TO)
    return LogClassK(factor * default.phi1, default.phi2 / factor, default.phi3)


def _no_reader(*_: object) -> tuple[()]:
    """Return nothing; a velocity filter passes states itself and calls no reader of the plant."""
    return ()
