"""All decisions of the node, without ROS: from messages and two clocks to a velocity.

The node calls `hear_…` for messages and `step` when a command comes, or a period has passed. A
fault is zero at once, with its reason; after it the filter continues.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers.many import each
from hcbf_gym.errors import HcbfError, InvalidInputError, finite_array, shown
from hcbf_gym.filter.samples import real_numbers
from hcbf_gym.programs import FilterStatus
from hcbf_robots.maps.nav2 import Raster
from hcbf_robots.online import VelocityFilter
from hcbf_robots.ros import filters, sources
from hcbf_robots.ros.decisions import Action, Decision, Level
from hcbf_robots.ros.localization import Localization
from hcbf_robots.ros.observed import Source
from hcbf_robots.ros.parameters import by_name
from hcbf_robots.ros.settings import Settings
from hcbf_robots.ros.sources import Beams, Entries
from hcbf_robots.ros.watches import ClockWatch, Fault, Now, Watch

INSIDE = "the robot is inside"
ZERO = 1e-9
"""A velocity below it is zero, as in the collision monitor."""


class NodeCore:
    """Decides the robot's velocity.

    `of_scan`, `of_grid` and `planned` prepare, and may run in another thread than the rest; their
    results go to `hear_source` and `take`. Guidance's field is computed where a filter begins, and
    that takes time: where the filter has to begin anew, one without guidance runs until another
    has been `planned`.

    Args:
        settings: the node's parameters; their `v_max` is the cap that there is now.

    Raises:
        InvalidInputError: if a file cannot be read, or robot, program and speeds do not fit.

    Attributes:
        sources: name → `Source`.
        localization: where the robot is.
        enabled: whether it filters; else fresh velocities pass.
    """

    def __init__(self, settings: Settings):
        self.settings = settings
        self.enabled = settings.enabled
        tolerance = settings.transform_tolerance
        self._command = Watch("command", settings.cmd_vel_timeout, tolerance)
        self._clock = ClockWatch(settings.clock_timeout)
        self.localization = Localization(settings)
        self.sources = {one.name: Source(one, settings) for one in settings.sources}
        robot = filters.robot_of(settings)
        self._filter = self._plain = filters.made(robot, settings, [], None)
        if settings.guidance:  # its errors come before a goal does
            filters.made(robot, settings, [], (0.5, 0.0))
        self._lost: Array | None = None  # the goal of a field that is dropped
        self._plans = False  # whether it has to be computed again
        self._size = len(robot.command.limits)
        self._wanted = np.zeros(self._size)
        for one in self.sources.values():
            one.begin(self.fastest, self._filter.check)
        self._alarm: tuple[float, Fault] | None = None  # until when [steady s]
        self._zero_since: float | None = -math.inf  # silent until the first command
        self._last: tuple[float, Decision] | None = None
        self._names: list[str] = []
        self._frame: Array | None = None  # odometry's in the global one, which places scans
        self._show()

    @property
    def fastest(self) -> float:
        """The greatest commanded speed [m/s]."""
        return self._filter.fastest

    @property
    def place(self) -> Array:
        """(3,) the newest pose in the global frame [m, rad]; zeros where there is none."""
        newest = self.localization.newest
        return np.zeros(3) if newest is None else newest.pose

    def hear_command(
        self, command: ArrayLike, now: Now, stamp: float | None = None, frame: str = ""
    ) -> bool:
        """Take the nominal velocity (3,) in the robot's axes [m/s, rad/s]; return if it is valid.

        A message has no stamp (None) where its type has none, and "" as its frame.
        """
        self._clock.see(now)
        if self._zero_since == -math.inf:
            self._zero_since = None
        given = real_numbers(command, (3,))
        expected = self.settings.base_frame_id if frame else ""
        if given is None:
            return self._command.refuse(f"got {shown(command)}, expected three finite numbers")
        if stamp is None:
            self._command.forget()  # without a stamp the newest is the last that came
        heard = self._command.hear(now.ros if stamp is None else stamp, now, frame, expected)
        if heard:
            self._wanted = given[[0, 2]] if self._size == 2 else given
        return heard

    def hear_odometry(
        self, pose: ArrayLike, twist: ArrayLike, stamp: float, now: Now, *frames: str
    ) -> None:
        """Take the odometry, see `Localization.hear_odometry`."""
        self._clock.see(now)
        if self.localization.hear_odometry(pose, twist, stamp, now, *frames):
            for source in self.sources.values():
                if source.is_scan:  # its place is unknown now
                    source.watch.forget()
            self._begin_anew()

    def hear_source(
        self, name: str, entries: Entries, stamp: float, now: Now, frame: str = ""
    ) -> bool:
        """Take what a source shows from now on; return whether it differs from before.

        A scan, in the robot's axes, counts only where the present odometry reaches back to its
        stamp [s].
        """
        source = self.sources[name]
        if not source.is_scan:
            differs = source.hear(entries, stamp, now, frame)
            if differs:
                self._show()
            return differs
        newest = self.localization.newest
        pose = self.localization.at(stamp)
        if newest is not None and not self.settings.base_shift_correction:
            pose = newest.local
        accepted = source.hear_scan(entries, pose, stamp, now, frame)
        if accepted:
            self._frame = None  # it is not placed yet
            if newest is not None:
                self._place_scans(newest.frame)
        return accepted

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
        for name, enabled in values.items():
            source = self.sources[name.split(".")[0]]
            if enabled != source.enabled:
                source.enabled = enabled
                self._plans = self.goal is not None
                self._show()

    def activate(self) -> None:
        """Begin to publish: the command and the goal of before count no more."""
        self._command.forget()
        if self.goal is not None:
            if self._filter.goal is not None:
                self._switch(self._plain)
            self._lost, self._plans = None, False
            self._show()

    def of_scan(
        self, name: str, beams: Beams, mount: ArrayLike | None = None, stamp: float | None = None
    ) -> Entries:
        """Return what a scan shows in the robot's axes at its stamp.

        Args:
            name: of the source.
            beams: the scan.
            mount: (3,) of the sensor on the robot; None takes the parameter.
            stamp: of the first beam [s]: each counts from the robot's place at its time; None for
                beams of one time.

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
        """Return what an occupancy grid shows; `limits` replace parameters of a mask.

        Raises:
            InvalidInputError: if its values make no classes, or no input satisfies a limit.
        """
        source = self.sources[name]
        settings = replace(source.settings, **(limits or {}))
        made = sources.of_grid(settings, raster, self.fastest, source.entries)
        if settings.type == "speed":
            self._filter.check(made)
        return made

    def planned(self, goal: ArrayLike | None) -> VelocityFilter:
        """Return a filter that leads to a goal (2,) [m], its field computed; pass it to `take`.

        Raises:
            InvalidInputError: if no path leads there.
        """
        made = filters.made(self._filter.robot, self.settings, self._shown, goal)
        if goal is not None:
            newest = self.localization.newest
            if newest is None:
                raise InvalidInputError("goal: there is no pose yet, expected odometry first")
            state = newest.local, newest.twist, newest.stamp
            _, report = made.step(np.zeros(self._size), *state, frame=newest.frame)
            if report["reason"] == Reason.GOAL:
                raise InvalidInputError(made.lost)
            if report["reason"] == Reason.BARRIERS:
                at = np.asarray(goal).tolist()
                raise InvalidInputError(f"goal: got {at}, expected barriers that are accepted")
        return made

    def wait(self, goal: ArrayLike) -> None:
        """Let a goal (2,) [m] wait for the first pose; then `goal_to_plan` returns it."""
        self._lost, self._plans = finite_array("goal", goal, (2,)), True

    def take(self, planned: VelocityFilter) -> None:
        """Continue with a filter that was `planned`, under the cap that there is now."""
        self._switch(planned)
        self._lost, self._plans = None, False
        self._show()

    @property
    def goal(self) -> Array | None:
        """(2,) where guidance leads, or will again [m]."""
        return self._lost if self._filter.goal is None else self._filter.goal

    def goal_to_plan(self) -> Array | None:
        """Return the goal that must be `planned` again, once; None where none must."""
        if self._last is None:  # a fault
            return None
        plans, self._plans = self._plans, False
        return self.goal if plans else None

    def step(self, now: Now) -> Decision:
        """Decide the robot's velocity now."""
        self._clock.see(now)
        back = self._clock.went_back()
        if back is not None:
            self._forget()
        if not self.enabled:
            return self._passed(now)
        if self._clock.fault(now) is not None:
            self._begin_anew()  # the robot may move meanwhile, at no time of this clock
        faults = [one for one in (back, *self._faults(now)) if one is not None]
        if not faults and self._last is not None and now.ros == self._last[0]:
            return self._silenced(self._last[1], now)  # a simulator's clock ticks more slowly
        try:
            decision = self._stopped(faults, now) if faults else self._filtered(now)
        except HcbfError as error:  # nothing should raise here, and the node must not end
            faults = [*faults, Fault("filter", str(error))]
            decision = self._zero(faults, "filter")
            self._begin_anew()
        self._last = None if faults else (now.ros, decision)
        return self._silenced(decision, now)

    def _faults(self, now: Now) -> list[Fault | None]:
        """Return what requires zero, the gravest first."""
        if self._alarm is not None and now.steady >= self._alarm[0]:
            self._alarm = None
        return [
            self._clock.fault(now),
            *self.localization.faults(now),
            None if self._alarm is None else self._alarm[1],
            *(one.watch.fault(now) for one in self.sources.values() if one.enabled),
            self._command.fault(now),
        ]

    def _filtered(self, now: Now) -> Decision:
        """Return the filter's decision."""
        last = self.localization.newest
        if last is None:  # the newest message has jumped
            return self._stopped([Fault("odometry", "nothing received")], now)
        self._place_scans(last.frame)
        for name, source in self.sources.items():
            if source.stops(last.pose[:2], self._filter.robot.reach):
                return self._stopped([Fault(name, INSIDE)], now)
        wanted = self._wanted
        stamp = min(last.stamp, now.ros)  # ahead by no more than the tolerance
        command, report = self._filter.step(
            wanted, last.local, last.twist, stamp, now.ros, last.frame
        )
        status, reason = FilterStatus(int(report["status"])), Reason(int(report["reason"]))
        if reason.lasts:
            fault = Fault("robot", reason.text)
            self._alarm = now.steady + self.settings.alarm_pause, fault
            self._begin_anew()
            return self._stopped([fault], now)
        if status == FilterStatus.BACKUP:
            why = f": {self._filter.lost}" if reason == Reason.GOAL else ""
            message = f"filter: {reason.text}{why}"
            return Decision(command, wanted, Level.ERROR, message, Action.STOP, "filter", report)
        levels = {FilterStatus.RELAXED: Level.WARN}
        level = Level.OK if status <= FilterStatus.SAFE else levels.get(status, Level.ERROR)
        changed = report["intervention"] > 1e-3
        name = self._nearest(report) if changed or status > FilterStatus.SAFE else ""
        message = f"{status.name}{': ' + name if name else ''}"
        action = Action.LIMIT if changed else Action.DO_NOTHING
        return Decision(command, wanted, level, message, action, name if changed else "", report)

    def _nearest(self, report: Info) -> str:
        """Return the name of the largest slack, or else of the least h after its margin."""
        if not self._names:
            return ""
        slack = report["slack"][: len(self._names)]
        if slack.size and slack.max() > 0.0:
            return self._names[int(np.argmax(slack))]
        left = (report["h"] - report["margin"])[: len(self._names)]
        return self._names[int(np.argmin(left))] if np.isfinite(left).any() else ""

    def _stopped(self, faults: list[Fault], now: Now) -> Decision:
        """Return zero, and let the filter know that it is commanded."""
        report = None
        if math.isfinite(now.ros) and (self._last is None or now.ros > self._last[0]):
            _, report = self._filter.step(np.zeros(self._size), None, None, math.nan, now.ros)
        idle = [one.source for one in faults] == ["command"] and "old" in faults[0].message
        invalid = faults[0].source in self.sources and faults[0].message != INSIDE
        decision = self._zero(faults, "invalid source" if invalid else faults[0].source)
        level = Level.STALE if idle else Level.ERROR
        return decision._replace(level=level, report=report)

    def _zero(self, faults: list[Fault], name: str) -> Decision:
        zero, message = np.zeros(self._size), "; ".join(map(str, faults))
        return Decision(zero, self._wanted, Level.ERROR, message, Action.STOP, name, None)

    def _passed(self, now: Now) -> Decision:
        """Return the nominal velocity while it is fresh: the node is not enabled."""
        fault = self._command.fault(now)
        command = self._wanted.copy() if fault is None else np.zeros(self._size)
        message = "not enabled" + (f"; {fault}" if fault else "")
        passed = Decision(command, self._wanted, Level.WARN, message, Action.DO_NOTHING, "", None)
        return self._silenced(passed, now)

    def _silenced(self, decision: Decision, now: Now) -> Decision:
        """Return the decision, without a command where zero was published for long enough."""
        assert decision.command is not None
        if np.abs(decision.command).max() > ZERO:
            self._zero_since = None
            return decision
        if self._zero_since is None:
            self._zero_since = now.steady
        silent = now.steady - self._zero_since > self.settings.stop_pub_timeout
        return decision._replace(command=None) if silent else decision

    def _switch(self, other: VelocityFilter) -> None:
        """Continue with another filter, under the cap."""
        other.v_max = self.settings.v_max or None
        other.go_on_from(self._filter)
        self._filter = other

    def _begin_anew(self) -> None:
        """Let the filter forget the past, and guidance's field with it."""
        goal = self._filter.goal
        if goal is not None:
            self._switch(self._plain)
            self._lost, self._plans = goal, True
        self._filter.reset()
        if goal is not None:
            self._show()

    def _forget(self) -> None:
        """Begin anew: the clock has gone back, and stamps from before mean nothing."""
        self._command.forget()
        self.localization.forget()
        for source in self.sources.values():
            source.forget_stamps()
        self._last = None
        self._begin_anew()

    def _place_scans(self, frame: Array) -> None:
        """Place scans by odometry's frame (3,) as it is now [m, rad].

        So a correction of the pose moves them, too: the robot's place was wrong, and not how far
        away it saw something.
        """
        if self._frame is not None and np.array_equal(frame, self._frame):
            return
        self._frame = frame
        scans = [one for one in self.sources.values() if one.measured is not None]
        for source in scans:
            source.place(frame)
        if scans:
            self._show()

    @property
    def _shown(self) -> list[Any]:
        return [e for one in self.sources.values() if one.enabled for e in one.entries]

    def _show(self) -> None:
        """Give the filter what the sources show; guidance looks at it in `planned` alone."""
        shown = self._shown
        self._names = [one.name for one in each(shown)]
        self._filter.set_barriers(shown, look=False)
