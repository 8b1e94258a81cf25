"""Undeclared faults between command and motion, put into the drive of a robot."""

import itertools
import math
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

Fault = Callable[[Any], None]
"""Puts itself into a drive."""


def late(seconds: float, first: Any, period: float = 0.02) -> Callable[[Any], Any]:
    """Return a function of values that returns the value of some time ago [s]."""
    waiting = deque([first] * round(seconds / period))

    def past(value: Any) -> Any:
        waiting.append(value)
        return waiting.popleft()

    return past


def following(drive: Any, change: Callable[[Any], Any]) -> None:
    """Let the controller of a walker get a change of the command."""
    act = drive.act

    def changed() -> None:
        commanded = drive.command.copy()
        drive.command[:] = change(commanded)
        act()
        drive.command[:] = commanded

    drive.act = changed


def follows(share: float) -> Fault:
    """Return a fault: the controller gets a share of the command."""
    return partial(following, change=lambda u: share * u)


def follows_late(drive: Any, seconds: float) -> None:
    """Let the controller get a command late."""
    period = drive.simulation.walker.period
    following(drive, late(seconds, np.zeros(len(drive.command)), period))


def floor(drive: Any, friction: float) -> None:
    """Put a walker on another floor."""
    model = drive.simulation.model
    model.geom_friction[model.geom("floor").id, 0] = friction


def compass(drive: Any, off: float) -> None:
    """Let the heading be off [rad]."""
    plain = type(drive.simulation)

    class Turned(plain):
        @property
        def yaw(self) -> float:
            return plain.yaw.fget(self) + off  # type: ignore[attr-defined]

    drive.simulation.__class__ = Turned


def scaled_odometry(drive: Any, share: float) -> None:
    """Let odometry count a share of the path and of the velocity; 0 is dead."""
    plain, start = drive.odometry, drive.truth.copy()
    start[2:] = 0.0

    def scaled() -> tuple[Any, float]:
        body, yaw = plain()
        return start + share * (body - start), yaw

    drive.odometry = scaled


def late_odometry(drive: Any, seconds: float) -> None:
    """Let odometry be late, with fresh stamps."""
    plain = drive.odometry
    past = late(seconds, plain())

    def delayed() -> tuple[Any, float]:
        body, yaw = plain()
        return past((body.copy(), yaw))

    drive.odometry = delayed


def acting(drive: Any, change: Callable[[int, Any], Any]) -> None:
    """Change the k-th action, as a wrapper inside does that keeps the space."""
    hold, count = drive.hold, itertools.count()
    drive.hold = lambda u, *rest: hold(change(next(count), u), *rest)


def late_actions(drive: Any, seconds: float) -> None:
    """Delay actions, as a wrapper inside does."""
    past = late(seconds, np.zeros(2))
    acting(drive, lambda k, u: past(u))


def known_as(walker: Any, change: Callable[[Any, Any], Any]) -> None:
    """Let the A1 know another position, by its start and the true one."""
    plain, start = walker.estimate, walker.truth[:2].copy()

    def wrong(time: float) -> Any:
        estimate = plain(time)
        x, lag = estimate.x.copy(), estimate.lag.copy()
        x[:2] = change(start, x[:2])
        lag[:2] += x[:2] - estimate.x[:2]
        return estimate._replace(x=x, lag=lag)

    walker.estimate = wrong


def late_position(walker: Any, seconds: float) -> None:
    """Let the A1 know its position late."""
    past = late(seconds, walker.truth[:2].copy())
    known_as(walker, lambda start, now: past(now.copy()))


def slippery(walker: Any, friction: float) -> None:
    """Let the A1's feet find less friction than is declared."""
    simulation = walker.simulation
    simulation.model.geom_friction[simulation._feet, 0] = friction


def late_torques(walker: Any, seconds: float) -> None:
    """Let the A1's torques come late."""
    waiting = walker.simulation._delayed
    for _ in range(round(seconds / walker.simulation.model.opt.timestep) - len(waiting)):
        waiting.appendleft(waiting[0].copy())


def turned(_: int, u: Any, by: float = 1.2) -> Any:
    """Return an acceleration (2,) in axes that are off by an angle [rad]."""
    cos, sin = math.cos(by), math.sin(by)
    return np.array([cos * u[0] - sin * u[1], sin * u[0] + cos * u[1]])


ACTING: dict[str, Fault] = {
    "every third action reversed": partial(acting, change=lambda k, u: -u if k % 3 == 0 else u),
    "actions times .5": partial(acting, change=lambda k, u: 0.5 * u),
}
WALKER: dict[str, Fault] = {
    "dead odometry": partial(scaled_odometry, share=0.0),
    "half odometry": partial(scaled_odometry, share=0.5),
    "odometry 500 ms late": partial(late_odometry, seconds=0.5),
    "does not move": follows(0.0),
    "follows by half": follows(0.5),
    "follows 1.5 times": follows(1.5),
    "reverses": follows(-1.0),
    "follows 500 ms late": partial(follows_late, seconds=0.5),
    "floor .03": partial(floor, friction=0.03),
    "floor .1": partial(floor, friction=0.1),
    "compass off by 1.2": partial(compass, off=1.2),
    **ACTING,
}
A1: dict[str, Fault] = {
    "dead position": partial(known_as, change=lambda start, now: start),
    "half the position": partial(known_as, change=lambda start, now: 0.5 * (start + now)),
    "position 500 ms late": partial(late_position, seconds=0.5),
    "torques 16 ms late": partial(late_torques, seconds=0.016),
    "floor .1": partial(slippery, friction=0.1),
    "floor .3": partial(slippery, friction=0.3),
    "compass off by 1.2": partial(acting, change=turned),
    "actions 200 ms late": partial(late_actions, seconds=0.2),
    **ACTING,
}
