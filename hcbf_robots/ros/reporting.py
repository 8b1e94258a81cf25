"""Publishes the diagnostics, the collision monitor's state, the report and the markers."""
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

MARKER_PERIOD = 0.2
"""Shortest time between two arrays of markers [s]."""


class Reporter:
    """Publishes each decision to those who listen, and changes of level or action to all.

    Args:
        core: the node's core.
        name: the node's name.
        publisher: returns a publisher of a message type on a topic.
    """

    def __init__(self, core: NodeCore, name: str, publisher: Callable[[Any, str], Any]):
        self._core, self._name = core, name
        self._diagnostics = publisher(DiagnosticArray, "/diagnostics")
        self._report = publisher(DiagnosticArray, "~/report")
        self._markers = publisher(MarkerArray, "~/markers")
        self._state_type = optional.nav2("CollisionMonitorState") or KeyValue
        topic = core.settings.state_topic
        self._state = publisher(self._state_type, topic) if topic else None
        self._decision: Decision | None = None
        self._last_diagnosis = self._last_state = ("", "")
        self._latency = self._slowest = 0.0
        self._markers_at = 0.0  # when markers were published last [steady s]

    def note_latency(self, latency: float) -> None:
        """Note how long a command took from its arrival to its publication [s]."""
        self._latency, self._slowest = latency, max(self._slowest, latency)

    def publish(self, decision: Decision, now: Now, stamp: Any) -> None:
        """Publish a decision; `stamp` is the present, as a `builtin_interfaces/Time`."""
        self._decision = decision
        diagnosis = decision.level.name, decision.message.split(":")[0]
        if diagnosis != self._last_diagnosis:
            self._last_diagnosis = diagnosis
            self.diagnose(now, stamp)
        self._publish_state(decision)
        if self._report.get_subscription_count() > 0:
            self._report.publish(_array(_report(decision), stamp))
        is_due = now.steady - self._markers_at > MARKER_PERIOD
        if is_due and self._markers.get_subscription_count() > 0:
            self._markers_at = now.steady
            self._markers.publish(markers.marker_array(self._core, decision, stamp))

    def _publish_state(self, decision: Decision) -> None:
        """Publish the collision monitor's state where it has changed."""
        state = decision.action.name, decision.name
        if self._state is None or state == self._last_state:
            return
        self._last_state = state
        if self._state_type is KeyValue:  # without Nav2
            message = KeyValue(key=decision.action.name, value=decision.name)
        else:
            fields = {"action_type": int(decision.action), "polygon_name": decision.name}
            message = self._state_type(**fields)
        self._state.publish(message)

    def diagnose(self, now: Now, stamp: Any) -> None:
        """Publish the diagnostics of the last decision; the node calls it once a second, too."""
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
        for name, source in core.sources.items():
            fault = source.watch.fault(now)
            state = "ok" if fault is None else fault.message
            values[f"source {name}"] = state if source.enabled else "off"
        status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
        self._slowest = 0.0
        self._diagnostics.publish(_array(status, stamp))


def _report(decision: Decision) -> DiagnosticStatus:
    """Return all numbers of a step as a message, which bags can record."""
    nothing = np.full(len(decision.nominal), np.nan)
    command = nothing if decision.command is None else decision.command
    report = {"wanted": decision.nominal, "given": command, **(decision.report or {})}
    values = []
    for key, numbers in report.items():
        words = [f"{number:.6g}" for number in np.atleast_1d(numbers)]
        values.append(KeyValue(key=key, value=" ".join(words)))
    level = bytes([decision.level])
    return DiagnosticStatus(level=level, name="report", message=decision.message, values=values)


def _array(status: DiagnosticStatus, stamp: Any) -> DiagnosticArray:
    message = DiagnosticArray(status=[status])
    message.header.stamp = stamp
    return message
