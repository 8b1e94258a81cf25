"""What the node decides at a moment, in the terms of ROS's diagnostics and Nav2's monitor."""

from enum import IntEnum
from typing import NamedTuple

from hcbf_gym.arrays import Array, Info

Level = IntEnum("Level", ["OK", "WARN", "ERROR", "STALE"], start=0)
"""As `diagnostic_msgs/DiagnosticStatus` counts them."""
Action = IntEnum("Action", ["DO_NOTHING", "STOP", "SLOWDOWN", "APPROACH", "LIMIT"], start=0)
"""As `nav2_msgs/CollisionMonitorState` counts them."""


class Decision(NamedTuple):
    """What to do now."""

    command: Array | None  # (k,) for the robot, in its own axes [m/s, rad/s]; None: publish nothing
    wanted: Array  # (k,) the nominal command; zeros where there is none
    level: Level
    message: str
    action: Action
    name: str  # of what the action was for
    report: Info | None  # of the filter; None where it was not called
