"""The velocity filter that parameters describe."""

from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_robots.online import Command, Response, Robot, VelocityFilter
from hcbf_robots.online.robot import known_of
from hcbf_robots.ros.parameter import naming
from hcbf_robots.ros.parameters import Settings

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
    """Return a filter as the parameters ask for it.

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


class Led:
    """The filter at hand, and the goal to which it leads.

    Guidance's field is computed where a filter begins, and that takes time: where the filter has to
    begin anew, one without guidance goes on until another is planned beside the commands' path.

    Args:
        settings: the node's parameters.

    Attributes:
        filter: at hand.
    """

    def __init__(self, settings: Settings):
        robot = robot_of(settings)
        self.filter = self._plain = made(robot, settings, [], None)
        if settings.guidance:
            made(
                robot, settings, [], (0.5, 0.0)
            )  # what is wrong with it is found before a goal comes
        self._lost: Array | None = None  # the goal of a field that is no more
        self._asks = False  # whether it has to be computed again

    @property
    def goal(self) -> Array | None:
        """(2,) where guidance leads, or will again [m]."""
        return self._lost if self.filter.goal is None else self.filter.goal

    def take(self, planned: VelocityFilter, v_max: float) -> None:
        """Go on with another filter, under the cap that there is now [m/s], 0 for none."""
        planned.v_max = v_max or None
        planned.go_on_from(self.filter)
        self.filter, self._lost, self._asks = planned, None, False

    def begin_anew(self, v_max: float) -> bool:
        """Forget the past; return whether another filter goes on."""
        goal = self.filter.goal
        if goal is not None:
            self.take(self._plain, v_max)
            self._lost, self._asks = goal, True
        self.filter.reset()
        return goal is not None

    def wait(self, goal: Array) -> None:
        """Ask for a field to a goal (2,) [m] later: nobody knows yet where it has to begin."""
        self._lost, self._asks = goal, True

    def ask(self) -> None:
        """Ask for the field again: what it goes through is something else."""
        self._asks = self.goal is not None

    def drop_goal(self, v_max: float) -> None:
        """Go on without guidance, under the cap [m/s], 0 for none."""
        if self.filter.goal is not None:
            self.take(self._plain, v_max)
        self._lost, self._asks = None, False

    def goal_to_plan(self) -> Array | None:
        """Return the goal for which a filter has to be planned, once; None where none has."""
        asks, self._asks = self._asks, False
        return self.goal if asks else None
