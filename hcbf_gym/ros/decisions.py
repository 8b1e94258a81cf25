"""What the node decides at a moment, in the terms of ROS's diagnostics and Nav2's monitor."""

from enum import IntEnum
from typing import NamedTuple

from hcbf_gym.arrays import Array, Info

Level = IntEnum("Level", ["OK", "WARN", "ERROR", "STALE"], start=0)
"""As `diagnostic_msgs/DiagnosticStatus` counts them."""
Action = IntEnum("Action", ["DO_NOTHING", "STOP", "SLOWDOWN", "APPROACH", "LIMIT"], start=0)
"""As `nav2_msgs/CollisionMonitorState` counts them."""


class Decision(NamedTuple):
    """What to do now.

    Attributes:
        command: (k,) for the robot, in its own axes [m/s, rad/s]; None: publish nothing.
        wanted: (k,) the nominal command; zeros where there is none.
        level: of the diagnostics.
        message: why.
        action: what was done to the nominal velocity.
        name: of what it was done for.
        report: of the filter; None where it was not called.
    """

    command: Array | None
    wanted: Array
    level: Level
    message: str
    action: Action
    name: str
    report: Info | None
