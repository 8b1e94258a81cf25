"""The velocity filter that parameters describe."""

from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from hcbf_robots.online import Command, Response, Robot, VelocityFilter
from hcbf_robots.online.robot import known_of
from hcbf_robots.ros.parameter import naming
from hcbf_robots.ros.settings import Settings

HELD = 1.3
"""Periods of the node for which the filter's rows hold: timers and messages jitter."""


def robot_of(settings: Settings) -> Robot:
    """Return the robot that parameters describe.

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
            response.gains(len(command.limits))  # fit
    with naming("footprint"):
        return Robot(command, response, settings.reach, settings.footprint or None)


def made(robot: Robot, settings: Settings, scene: Any, goal: ArrayLike | None) -> VelocityFilter:
    """Return a filter by the parameters.

    Raises:
        InvalidInputError: if the cap leaves no speed.
    """
    found = VelocityFilter(
        robot,
        scene,
        settings.program,
        period=HELD * settings.period,
        goal=goal,
        guidance=settings.guidance or None if goal is not None else None,
        max_age=settings.odom_timeout,
        on_alarm="brake",
    )
    with naming("v_max"):
        found.v_max = settings.v_max or None
    return found
