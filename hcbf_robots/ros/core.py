"""All decisions of the node, without ROS: from messages and two clocks to a velocity.

The node calls `hear_…` for messages, and `step` when a command comes or a period has passed. A
fault leads to zero velocity at once, with its reason. When it ends, the filter continues.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array
from hcbf_gym.barriers.many import each
from hcbf_gym.errors import HcbfError, InvalidInputError, finite_array, shown
from hcbf_gym.filter.samples import real_numbers
from hcbf_robots.maps.nav2 import Raster
from hcbf_robots.online import VelocityFilter
from hcbf_robots.ros import decisions, filters, sources
from hcbf_robots.ros.decisions import Action, Decision, Level
from hcbf_robots.ros.localization import Localization
from hcbf_robots.ros.observed import Source
from hcbf_robots.ros.parameters import by_name
from hcbf_robots.ros.settings import Settings
from hcbf_robots.ros.sources import Beams, Entries
from hcbf_robots.ros.watches import ClockWatch, Fault, HeldFault, Now, Watch

INSIDE = "the robot is inside"
ZERO = 1e-9
"""A velocity below it is zero, as in the collision monitor [m/s, rad/s]."""


class NodeCore:
    """Decides the robot's velocity.

    `of_scan`, `of_grid` and `planned` prepare, and may run in another thread than the rest; their
    results go to `hear_source` and `take`. Guidance's field takes long to compute. So when the
    filter must restart, one without guidance continues until another has been `planned`.

    Args:
        settings: the node's parameters; `settings.v_max` follows later changes of the cap.

    Raises:
        InvalidInputError: if a file cannot be read, or robot, program and speeds do not fit.

    Attributes:
        sources: name → `Source`.
        localization: where the robot is.
        enabled: whether it filters; otherwise nominal velocities that are not stale pass.
    """

    def __init__(self, settings: Settings):
        self.settings = settings
        self.enabled = settings.enabled
        tolerance = settings.transform_tolerance
        self._command = Watch("command", settings.cmd_vel_timeout, tolerance)
        self._clock = ClockWatch(settings.clock_timeout)
        self._alarm = HeldFault()
        self.localization = Localization(settings)
        self.sources = {source.name: Source(source, settings) for source in settings.sources}
        robot = filters.robot_of(settings)
        self._filter = self._unguided = filters.velocity_filter(robot, settings, [], None)
        if settings.guidance:  # finds its errors now, and not when a goal comes
            filters.velocity_filter(robot, settings, [], (0.5, 0.0))
        self._dropped_goal: Array | None = None  # whose field was dropped, or waits for a pose
        self._must_plan = False  # whether the field must be computed again
        self._command_size = len(robot.command.limits)
        self._nominal = np.zeros(self._command_size)
        for source in self.sources.values():
            source.begin(self.fastest, self._filter.check)
        self._zero_since: float | None = -math.inf  # [steady s]; silent until the first command
        self._last_decision: Decision | None = None  # of the last step; None after a fault
        self._last_time = -math.inf  # of that step [ros s]; −inf after a fault
        self._names: list[str] = []  # of the conditions, in the order of the report's rows
        self._scan_frame: Array | None = None  # odometry's in the global one, where scans are
        self._set_barriers()

    @property
    def fastest(self) -> float:
        """The greatest commanded speed [m/s]."""
        return self._filter.fastest

    @property
    def pose(self) -> Array:
        """(3,) the robot's newest pose in the global frame [m, rad]; zeros if it is unknown."""
        newest = self.localization.newest
        return np.zeros(3) if newest is None else newest.pose

    def hear_command(
        self, command: ArrayLike, now: Now, stamp: float | None = None, frame: str = ""
    ) -> bool:
        """Take the nominal velocity (3,) in the robot's axes [m/s, rad/s]; return if it is valid.

        A type of message without a header has no stamp (None), and "" as its frame.
        """
        self._clock.see(now)
        if self._zero_since == -math.inf:
            self._zero_since = None
        velocity = real_numbers(command, (3,))
        expected = self.settings.base_frame_id if frame else ""
        if velocity is None:
            return self._command.refuse(f"got {shown(command)}, expected three finite numbers")
        if stamp is None:
            self._command.forget()  # without a stamp the newest is the last that came
        is_new = self._command.hear(now.ros if stamp is None else stamp, now, frame, expected)
        if is_new:
            self._nominal = velocity[[0, 2]] if self._command_size == 2 else velocity
        return is_new

    def hear_odometry(
        self, pose: ArrayLike, twist: ArrayLike, stamp: float, now: Now, *frames: str
    ) -> None:
        """Take the odometry, see `Localization.hear_odometry`."""
        self._clock.see(now)
        has_jumped = self.localization.hear_odometry(pose, twist, stamp, now, *frames)
        if has_jumped:
            for source in self.sources.values():
                if source.is_scan:  # the pose at which it was measured is unknown now
                    source.watch.forget()
            self._restart_filter()

    def hear_source(
        self, name: str, entries: Entries, stamp: float, now: Now, frame: str = ""
    ) -> bool:
        """Replace the barriers of a source, measured at a stamp [s]; return whether they differ.

        Those of a scan are in the robot's axes. They are accepted only if the present odometry
        reaches back to the stamp.
        """
        source = self.sources[name]
        if not source.is_scan:
            differs = source.hear(entries, stamp, now, frame)
            if differs:
                self._set_barriers()
            return differs
        newest = self.localization.newest
        pose = self.localization.at(stamp)
        if newest is not None and not self.settings.base_shift_correction:
            pose = newest.local
        is_accepted = source.hear_scan(entries, pose, stamp, now, frame)
        if is_accepted:
            self._scan_frame = None  # the new scan is not placed yet
            if newest is not None:
                self._place_scans(newest.frame)
        return is_accepted

    def refuse_source(self, name: str, message: str) -> None:
        """Note that a source's newest message is faulty."""
        self.sources[name].watch.refuse(message)

    def change(self, given: Mapping[str, Any]) -> None:
        """Take parameters that may change while the node runs: all of them, or none.

        Raises:
            InvalidInputError: if one of the node's does not fit, or may not change now.
        """
        known, values = by_name(list(self.sources)), dict[str, Any]()
        for name, value in given.items():
            if name in known and not known[name].live:
                raise InvalidInputError(
                    f"parameter {name}: got {shown(value)} while the node is configured, expected "
                    "it before"
                )
            if name in known:
                values[name] = known[name].read(value, name)
        if "v_max" in values:  # the only one that may still be refused
            v_max = values.pop("v_max")
            self._filter.v_max = v_max or None
            self.settings = replace(self.settings, v_max=v_max)
        self.enabled = values.pop("enabled", self.enabled)
        for name, enabled in values.items():  # each is some "<source>.enabled"
            source = self.sources[name.split(".")[0]]
            if enabled != source.enabled:
                source.enabled = enabled
                self._must_plan = self.goal is not None
                self._set_barriers()

    def activate(self) -> None:
        """Forget the command and the goal that came before the node was activated."""
        self._command.forget()
        if self.goal is not None:
            if self._filter.goal is not None:
                self._replace_filter(self._unguided)
            self._dropped_goal, self._must_plan = None, False
            self._set_barriers()

    def of_scan(
        self, name: str, beams: Beams, mount: ArrayLike | None = None, stamp: float | None = None
    ) -> Entries:
        """Return the barriers of a scan, in the robot's axes at its stamp.

        Each beam counts from the robot's pose at its time, or from one pose if there is no stamp of
        the first beam [s]. Without `mount` (3,) [m, rad] the sensor has the parameter's pose.

        Raises:
            InvalidInputError: if it cannot be accepted, or odometry does not reach a beam.
        """
        source = self.sources[name]
        x, y, yaw = np.asarray(source.settings.mount if mount is None else mount).tolist()
        horizon = self._filter.horizon + math.hypot(x, y)
        horizon += source.settings.obstacle_speed * source.watch.timeout  # as it becomes older
        sweep = beams.sweep
        path = None if stamp is None or sweep == 0.0 else self.localization.path(stamp, sweep)
        return sources.of_scan(source.settings, beams, (x, y, yaw), horizon, path)

    def of_grid(
        self, name: str, raster: Raster, limits: Mapping[str, object] | None = None
    ) -> Entries:
        """Return the barriers of a grid; `limits` replace parameters of a speed mask by name.

        Raises:
            InvalidInputError: if its values make no classes, or no input satisfies a limit.
        """
        source = self.sources[name]
        settings = replace(source.settings, **(limits or {}))
        entries = sources.of_grid(settings, raster, self.fastest, source.entries)
        if settings.type == "speed":
            self._filter.check(entries)
        return entries

    def planned(self, goal: ArrayLike | None) -> VelocityFilter:
        """Return a filter for `take` that leads to a goal (2,) [m] by a computed field, or to none.

        Raises:
            InvalidInputError: if no path leads there.
        """
        planned = filters.velocity_filter(self._filter.robot, self.settings, self._entries(), goal)
        if goal is None:
            return planned
        newest = self.localization.newest
        if newest is None:
            raise InvalidInputError("goal: there is no pose yet, expected odometry first")
        state = newest.local, newest.twist, newest.stamp
        _, report = planned.step(np.zeros(self._command_size), *state, frame=newest.frame)
        if report["reason"] == Reason.GOAL:
            raise InvalidInputError(planned.lost)
        if report["reason"] == Reason.BARRIERS:
            position = np.asarray(goal).tolist()
            raise InvalidInputError(f"goal: got {position}, expected barriers that are accepted")
        return planned

    def wait(self, goal: ArrayLike) -> None:
        """Let a goal (2,) [m] wait for the first pose; then `goal_to_plan` returns it."""
        self._dropped_goal, self._must_plan = finite_array("goal", goal, (2,)), True

    def take(self, planned: VelocityFilter) -> None:
        """Continue with a filter that was `planned`, under the present cap."""
        self._replace_filter(planned)
        self._dropped_goal, self._must_plan = None, False
        self._set_barriers()

    @property
    def goal(self) -> Array | None:
        """(2,) where guidance leads, or will lead when its field is computed again [m]."""
        return self._dropped_goal if self._filter.goal is None else self._filter.goal

    def goal_to_plan(self) -> Array | None:
        """Return once the goal that must be `planned` again; None without one, or in a fault."""
        if self._last_decision is None:
            return None
        must_plan, self._must_plan = self._must_plan, False
        return self.goal if must_plan else None

    def step(self, now: Now) -> Decision:
        """Decide the robot's velocity now."""
        self._clock.see(now)
        went_back = self._clock.went_back()
        if went_back is not None:
            self._forget_stamps()
        if not self.enabled:
            return self._unfiltered(now)
        if self._clock.fault(now) is not None:
            self._restart_filter()  # no time of this clock shows how far the robot moves meanwhile
        faults = [fault for fault in (went_back, *self._faults(now)) if fault is not None]
        if self._last_decision is not None and not faults and now.ros == self._last_time:
            return self._silenced(self._last_decision, now)  # a simulator's clock ticks more slowly
        try:
            decision = self._stop(faults, now) if faults else self._filtered(now)
        except HcbfError as error:  # nothing should raise here, and the node must not end
            faults = [*faults, Fault("filter", str(error))]
            decision = self._zero(faults, "filter")
            self._restart_filter()
        self._last_decision, self._last_time = (None, -math.inf) if faults else (decision, now.ros)
        return self._silenced(decision, now)

    def _faults(self, now: Now) -> list[Fault | None]:
        """Return what requires zero velocity, the gravest first; None for each absent fault."""
        return [
            self._clock.fault(now),
            *self.localization.faults(now),
            self._alarm.at(now),
            *(source.watch.fault(now) for source in self.sources.values() if source.enabled),
            self._command.fault(now),
        ]

    def _filtered(self, now: Now) -> Decision:
        """Return the filter's decision, or zero velocity if a source or an alarm requires it."""
        newest = self.localization.newest
        if newest is None:  # the latest odometry has jumped
            return self._stop([Fault("odometry", "nothing received")], now)
        self._place_scans(newest.frame)
        for name, source in self.sources.items():
            if source.stops(newest.pose[:2], self._filter.robot.reach):
                return self._stop([Fault(name, INSIDE)], now)
        stamp = min(newest.stamp, now.ros)  # ahead by no more than the tolerance
        command, report = self._filter.step(
            self._nominal, newest.local, newest.twist, stamp, now.ros, newest.frame
        )
        reason = Reason(int(report["reason"]))
        if reason.lasts:
            alarm = Fault("robot", reason.text)
            self._alarm = HeldFault(alarm, now.steady + self.settings.alarm_pause)
            self._restart_filter()
            return self._stop([alarm], now)
        return decisions.filtered(command, self._nominal, report, self._names, self._filter.lost)

    def _stop(self, faults: list[Fault], now: Now) -> Decision:
        """Return zero velocity for faults, and let the filter know that zero is commanded."""
        zero, report = np.zeros(self._command_size), None
        if math.isfinite(now.ros) and now.ros > self._last_time:
            _, report = self._filter.step(zero, None, None, math.nan, now.ros)
        gravest = faults[0]
        # nothing is wrong when only the planner is silent, as between two goals
        is_idle = len(faults) == 1 and gravest.source == "command" and gravest.is_stale
        is_invalid_source = gravest.source in self.sources and gravest.message != INSIDE
        decision = self._zero(faults, "invalid source" if is_invalid_source else gravest.source)
        return decision._replace(level=Level.STALE if is_idle else Level.ERROR, report=report)

    def _zero(self, faults: list[Fault], name: str) -> Decision:
        """Return zero velocity with the messages of all faults; `name` is the action's cause."""
        zero, message = np.zeros(self._command_size), "; ".join(map(str, faults))
        return Decision(zero, self._nominal, Level.ERROR, message, Action.STOP, name, None)

    def _unfiltered(self, now: Now) -> Decision:
        """Return the nominal velocity unless it is stale: the node is not enabled."""
        fault = self._command.fault(now)
        command = self._nominal.copy() if fault is None else np.zeros(self._command_size)
        message = "not enabled" if fault is None else f"not enabled; {fault}"
        passed = Decision(command, self._nominal, Level.WARN, message, Action.DO_NOTHING, "", None)
        return self._silenced(passed, now)

    def _silenced(self, decision: Decision, now: Now) -> Decision:
        """Return the decision, without a command where zero was published for long enough."""
        assert decision.command is not None
        if np.abs(decision.command).max() > ZERO:
            self._zero_since = None
            return decision
        if self._zero_since is None:
            self._zero_since = now.steady
        is_silent = now.steady - self._zero_since > self.settings.stop_pub_timeout
        return decision._replace(command=None) if is_silent else decision

    def _replace_filter(self, other: VelocityFilter) -> None:
        """Continue with another filter from the same state, under the present cap."""
        other.v_max = self.settings.v_max or None
        other.go_on_from(self._filter)
        self._filter = other

    def _restart_filter(self) -> None:
        """Let the filter forget the past; guidance's field is dropped, and planned again later."""
        goal = self._filter.goal
        if goal is not None:
            self._replace_filter(self._unguided)
            self._dropped_goal, self._must_plan = goal, True
        self._filter.reset()
        if goal is not None:
            self._set_barriers()

    def _forget_stamps(self) -> None:
        """Drop all stamps, which mean nothing after the clock has gone back; restart the filter."""
        self._command.forget()
        self.localization.forget()
        for source in self.sources.values():
            source.forget_stamps()
        self._last_decision, self._last_time = None, -math.inf
        self._restart_filter()

    def _place_scans(self, frame: Array) -> None:
        """Place scans again where odometry's frame (3,) in the global one has changed [m, rad].

        A correction of the pose moves scans, too: the robot's pose was wrong, while the distances
        that it measured were right.
        """
        if self._scan_frame is not None and np.array_equal(frame, self._scan_frame):
            return
        self._scan_frame = frame
        scans = [source for source in self.sources.values() if source.measured is not None]
        for source in scans:
            source.place(frame)
        if scans:
            self._set_barriers()

    def _entries(self) -> list[Any]:
        """Return the barriers of all enabled sources."""
        enabled = [source for source in self.sources.values() if source.enabled]
        return [entry for source in enabled for entry in source.entries]

    def _set_barriers(self) -> None:
        """Give the filter the sources' barriers; guidance takes them up in `planned` alone."""
        entries = self._entries()
        self._names = [barrier.name for barrier in each(entries)]
        self._filter.set_barriers(entries, look=False)
