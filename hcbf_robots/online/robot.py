"""The robot of a loop of the user's own, as the filter must know it."""

from dataclasses import dataclass
from pathlib import Path

from numpy.typing import ArrayLike

from hcbf_gym import certificates
from hcbf_gym.errors import InvalidInputError, finite_float, require_packages, shown, text
from hcbf_robots.walkers import footprint as footprints
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import Response


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
            self.response.gains(len(self.command.limits))  # fit
        reach = finite_float("robot: reach", self.reach, minimum=0.0)
        if self.footprint is not None:
            object.__setattr__(self, "reach", max(reach, footprints.reach(self.footprint)))


def known_of(robot: object) -> Robot:
    """Return the `Robot` of a contract's path or name, a `Walker` or a `Robot`.

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


def cap_of(v_max: object, reserved: float, known: Robot) -> float:
    """Return a strict cap `v_max` on the speed [m/s]; its row reserves `reserved` [m/s].

    Raises:
        InvalidInputError: if it leaves no speed, or is above the greatest command.
    """
    least, most = 2.0 * reserved, known.command.fastest
    cap = finite_float("v_max", v_max, minimum=0.0, exclusive=True)
    if least < cap <= most:
        return cap
    measured = known.response is not None
    remedy = "" if measured else ", or measure how it follows by hcbf identify --log drive.csv"
    raise InvalidInputError(
        f"v_max: got {cap:g} m/s, expected above {least:.3g} m/s, twice what its row reserves for "
        f"the overshoot of {'a' if measured else 'an unmeasured'} robot, and at most "
        f"{most:g} m/s, the greatest command; leave v_max out where the robot's motors cap its "
        f"speed, or command no more: Command(forward={min(cap, most):g}, …){remedy}"
    )
