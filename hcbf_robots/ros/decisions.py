"""What the node decides at a moment, in the terms of ROS's diagnostics and Nav2's monitor."""

from enum import IntEnum
from typing import NamedTuple

from hcbf_gym.arrays import Array, Info


class Level(IntEnum):
    """As `diagnostic_msgs/DiagnosticStatus` counts them."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Action(IntEnum):
    """As `nav2_msgs/CollisionMonitorState` counts them."""

    DO_NOTHING = 0
    STOP = 1
    SLOWDOWN = 2
    APPROACH = 3
    LIMIT = 4


class Decision(NamedTuple):
    """What to do now.

    Attributes:
        command: (k,) for the robot, in its own axes [m/s, rad/s]; None: publish nothing.
        wanted: (k,) what was wanted; zeros where nothing is.
        level: of the diagnostics.
        says: why.
        action: what was done to the velocity wanted.
        name: of what it was done for.
        report: of the filter; None where it was not asked.
    """

    command: Array | None
    wanted: Array
    level: Level
    says: str
    action: Action
    name: str
    report: Info | None
