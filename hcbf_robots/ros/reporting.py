"""What the node reports: diagnostics, the collision monitor's state, report and markers."""
# pyright: reportMissingImports=false
# messages come with ROS, or with the extra ros-wheels

from collections.abc import Callable
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from visualization_msgs.msg import MarkerArray

from hcbf_robots.ros import markers, optional
from hcbf_robots.ros.core import NodeCore
from hcbf_robots.ros.decisions import Decision
from hcbf_robots.ros.watches import Now

SHOWN_EVERY = 0.2
"""Of the markers, while they have subscribers [s]."""


class Reporter:
    """Publishes after each command what has changed, and the diagnostics once a second.

    Args:
        core: the node's.
        name: of the node.
        publisher: makes a publisher of a message's type and a topic.
    """

    def __init__(self, core: NodeCore, name: str, publisher: Callable[[Any, str], Any]):
        self._core, self._name = core, name
        self._diagnostics = publisher(DiagnosticArray, "/diagnostics")
        self._report = publisher(DiagnosticArray, "~/report")
        self._markers = publisher(MarkerArray, "~/markers")
        self._state_kind = optional.state_message() or KeyValue
        topic = core.settings.state_topic
        self._state = publisher(self._state_kind, topic) if topic else None
        self._decision: Decision | None = None
        self._shown = self._published = ("", "")
        self._latency = self._slowest = 0.0
        self._marked = 0.0

    def note(self, latency: float) -> None:
        """Note how long a command took from its arrival to its publication [s]."""
        self._latency, self._slowest = latency, max(self._slowest, latency)

    def publish(self, decision: Decision, now: Now, stamp: Any) -> None:
        """Publish what has changed; `stamp` is now in ROS's form."""
        self._decision = decision
        kind = decision.level.name, decision.message.split(":")[0]
        if kind != self._shown:
            self._shown = kind
            self.diagnose(now, stamp)
        state = decision.action.name, decision.name
        if state != self._published and self._state is not None:
            self._published = state
            self._state.publish(_state(self._state_kind, decision))
        if self._report.get_subscription_count() > 0:
            self._report.publish(_array(_reported(decision), stamp))
        if now.steady - self._marked > SHOWN_EVERY and self._markers.get_subscription_count() > 0:
            self._marked = now.steady
            self._markers.publish(markers.of(self._core, decision, stamp))

    def diagnose(self, now: Now, stamp: Any) -> None:
        """Publish the diagnostics of the last decision."""
        decision, core = self._decision, self._core
        if decision is None:
            return
        silent = "" if decision.command is not None else " (silent)"
        status = DiagnosticStatus(
            level=bytes([decision.level]),
            name=f"{self._name}: velocity filter",
            message=decision.message + silent,
            hardware_id=core.settings.robot or "robot",
        )
        values = {
            "latency": f"{self._latency:.6f}",
            "slowest": f"{self._slowest:.6f}",
            "fastest": f"{core.fastest:.3f}",
            "enabled": str(core.enabled).lower(),
        }
        for name, one in core.sources.items():
            fault = one.watch.fault(now)
            values[f"source {name}"] = (
                "off" if not one.enabled else fault.message if fault else "ok"
            )
        status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
        self._slowest = 0.0
        self._diagnostics.publish(_array(status, stamp))


def _reported(decision: Decision) -> DiagnosticStatus:
    """Return all numbers of a step, for bags."""
    given = np.full(len(decision.wanted), np.nan) if decision.command is None else decision.command
    numbers = {"wanted": decision.wanted, "given": given, **(decision.report or {})}
    values = [
        KeyValue(key=key, value=" ".join(f"{n:.6g}" for n in np.atleast_1d(value)))
        for key, value in numbers.items()
    ]
    level = bytes([decision.level])
    return DiagnosticStatus(level=level, name="report", message=decision.message, values=values)


def _state(kind: Any, decision: Decision) -> Any:
    """Return the collision monitor's state, or its two fields as key and value without Nav2."""
    if kind is KeyValue:
        return KeyValue(key=decision.action.name, value=decision.name)
    return kind(action_type=int(decision.action), polygon_name=decision.name)


def _array(status: DiagnosticStatus, stamp: Any) -> DiagnosticArray:
    message = DiagnosticArray(status=[status])
    message.header.stamp = stamp
    return message
