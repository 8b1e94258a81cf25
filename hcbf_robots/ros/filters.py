"""The robot and the velocity filter that the node's parameters describe."""

from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from hcbf_robots.online import Command, Response, Robot, VelocityFilter
from hcbf_robots.online.robot import known_of
from hcbf_robots.ros.parameter import naming
from hcbf_robots.ros.settings import Settings

HELD = 1.3
"""Periods of the node for which the filter's rows hold, because timers and messages jitter."""


def robot_of(settings: Settings) -> Robot:
    """Return the robot of the contract `robot`, or that of the numbers in its place.

    Raises:
        InvalidInputError: if a file of it cannot be read, or its numbers do not fit.
    """
    if settings.robot:
        with naming("robot"):
            return known_of(settings.robot)
    command = Command(
        settings.max_forward,
        settings.max_turn,
        settings.max_sideways or None,
        settings.look_ahead or None,
    )
    response = None
    if settings.response_file:
        with naming("response_file"):
            response = Response.load(Path(settings.response_file))
            response.gains(len(command.limits))  # raises if it is another robot's response
    with naming("footprint"):
        return Robot(command, response, settings.reach, settings.footprint or None)


def velocity_filter(
    robot: Robot, settings: Settings, barriers: Any, goal: ArrayLike | None
) -> VelocityFilter:
    """Return a filter for a robot by the parameters, with guidance if there is a goal (2,) [m].

    Raises:
        InvalidInputError: if the cap leaves no speed.
    """
    new_filter = VelocityFilter(
        robot,
        barriers,
        settings.program,
        period=HELD * settings.period,
        goal=goal,
        guidance=None if goal is None else settings.guidance or None,
        max_age=settings.odom_timeout,
        on_alarm="brake",
    )
    with naming("v_max"):
        new_filter.v_max = settings.v_max or None
    return new_filter
