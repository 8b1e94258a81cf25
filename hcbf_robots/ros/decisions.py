"""What the node decides at a moment, in the terms of ROS's diagnostics and Nav2's monitor."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array, Info
from hcbf_gym.programs import FilterStatus

Level = IntEnum("Level", ["OK", "WARN", "ERROR", "STALE"], start=0)
"""As `diagnostic_msgs/DiagnosticStatus` counts them."""
Action = IntEnum("Action", ["DO_NOTHING", "STOP", "SLOWDOWN", "APPROACH", "LIMIT"], start=0)
"""As `nav2_msgs/CollisionMonitorState` counts them."""

MIN_INTERVENTION = 1e-3  # of the filter; a smaller one counts as none


class Decision(NamedTuple):
    """What the node publishes at a moment, and why."""

    command: Array | None  # (k,) velocity in the robot's axes [m/s, rad/s]; None: publish none
    nominal: Array  # (k,) the nominal velocity; zeros where there is none
    level: Level
    message: str
    action: Action
    name: str  # of the region, source or part that causes the action; "" for no action
    report: Info | None  # the filter's; None where it was not called


def filtered(command: Array, nominal: Array, report: Info, names: list[str], lost: str) -> Decision:
    """Return the decision that follows from a filter's command (k,) and its report.

    `names` are the conditions', in the report's order; `lost` is why guidance finds no path.
    """
    status, reason = FilterStatus(int(report["status"])), Reason(int(report["reason"]))
    if status == FilterStatus.BACKUP:
        cause = f": {lost}" if reason == Reason.GOAL else ""
        message = f"filter: {reason.text}{cause}"
        return Decision(command, nominal, Level.ERROR, message, Action.STOP, "filter", report)
    level = Level.WARN if status == FilterStatus.RELAXED else Level.ERROR
    if status <= FilterStatus.SAFE:
        level = Level.OK
    is_changed = report["intervention"] > MIN_INTERVENTION
    name = _tightest(report, names) if is_changed or status > FilterStatus.SAFE else ""
    message = f"{status.name}: {name}" if name else status.name
    action, cause = (Action.LIMIT, name) if is_changed else (Action.DO_NOTHING, "")
    return Decision(command, nominal, level, message, action, cause, report)


def _tightest(report: Info, names: list[str]) -> str:
    """Return the name of the largest slack; without slack, that of the least h after its margin."""
    if not names:
        return ""
    slack = report["slack"][: len(names)]
    if slack.size and slack.max() > 0.0:
        return names[int(np.argmax(slack))]
    clearance = (report["h"] - report["margin"])[: len(names)]
    return names[int(np.argmin(clearance))] if np.isfinite(clearance).any() else ""
