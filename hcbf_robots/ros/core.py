"""All that the node decides, without ROS: from what was heard and two clocks to a velocity.

The node calls `hear_…` for messages and `step` when a velocity is wanted, or a period has passed.
A fault is zero at once, with its reason; when it has gone, the filter goes on by itself.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers.many import each
from hcbf_gym.errors import HcbfError, InvalidInputError, finite_array, shown
from hcbf_gym.filter.samples import real_numbers
from hcbf_gym.models.plant import Reason
from hcbf_gym.programs import FilterStatus
from hcbf_robots.maps.nav2 import Raster
from hcbf_robots.online import VelocityFilter
from hcbf_robots.ros import filters, sources
from hcbf_robots.ros.decisions import Action, Decision, Level
from hcbf_robots.ros.filters import Led
from hcbf_robots.ros.localization import Localization
from hcbf_robots.ros.parameters import Settings, SourceSettings, by_name
from hcbf_robots.ros.sources import Beams, Entries, Measured, Source
from hcbf_robots.ros.watches import ClockWatch, Fault, Now, Watch

INSIDE = "the robot is inside"
ZERO = 1e-9
"""A velocity below it is zero, as in the collision monitor."""


class NodeCore:
    """Decides what the robot is told.

    `of_scan`, `of_grid`, `planned` and what else prepares may run in another thread than the rest;
    what they return is handed over by `hear_source` and `take`.

    Args:
        settings: the node's parameters.

    Raises:
        InvalidInputError: if a file cannot be read, or robot, program and speeds do not go
            together.

    Attributes:
        sources: name → what is known of it.
        localization: where the robot is.
    """

    def __init__(self, settings: Settings):
        self.settings = settings
        self.enabled = settings.enabled
        tolerance = settings.transform_tolerance
        self._command = Watch("command", settings.cmd_vel_timeout, tolerance)
        self._clock = ClockWatch(settings.clock_timeout)
        self.localization = Localization(settings)
        self.sources = sources.of_settings(settings)
        self._led = Led(settings)
        self._size = len(self._filter.robot.command.limits)
        self._wanted = np.zeros(self._size)
        for one in self.sources.values():
            sources.begin(one, self.fastest, self._filter.check)
        self._alarm: tuple[float, Fault] | None = None  # until when [steady s]
        self._zero_since: float | None = -math.inf  # silent until a velocity is wanted
        self._last: tuple[float, Decision] | None = None
        self._names: list[str] = []
        self._frame: Array | None = None  # odometry's in the global one, by which scans lie
        self._show()

    @property
    def _filter(self) -> VelocityFilter:
        return self._led.filter

    @property
    def fastest(self) -> float:
        """The greatest speed that the robot is told [m/s]."""
        return self._filter.fastest

    @property
    def place(self) -> Array:
        """(3,) the newest pose in the global frame [m, rad]; zeros where there is none."""
        newest = self.localization.newest
        return np.zeros(3) if newest is None else newest.pose

    # -- what is heard ----------------------------------------------------------------------------

    def hear_command(
        self, command: ArrayLike, now: Now, stamp: float | None = None, frame: str = ""
    ) -> bool:
        """Take the velocity wanted, in the robot's axes; return whether it is believed.

        Args:
            command: (3,) v_x, v_y [m/s] and ω [rad/s].
            now: the present.
            stamp: of the message [s]; None where it has none.
            frame: likewise; "" for the robot's.
        """
        self._clock.see(now)
        if self._zero_since == -math.inf:
            self._zero_since = None
        given = real_numbers(command, (3,))
        expected = self.settings.base_frame_id if frame else ""
        if given is None:
            says = f"got {shown(command)}, expected three finite numbers"
            return self._command.refuse(says)
        if stamp is None:
            self._command.forget()  # without a stamp the newest is the last that came
        heard = self._command.hear(now.ros if stamp is None else stamp, now, frame, expected)
        if heard:
            self._wanted = given[[0, 2]] if self._size == 2 else given
        return heard

    def activate(self) -> None:
        """Begin to publish: what was wanted, and where guidance led, counts no more."""
        self._command.forget()
        if self.goal is not None:
            self._led.drop_goal(self.settings.v_max)
            self._show()

    def hear_odometry(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        stamp: float,
        now: Now,
        frame: str = "",
        child: str = "",
    ) -> None:
        """Take the odometry, see `Localization.hear_odometry`."""
        self._clock.see(now)
        if self.localization.hear_odometry(pose, twist, stamp, now, frame, child):
            for source in self.sources.values():
                if source.settings.type == "scan":  # where it lies nobody knows any more
                    source.watch.forget()
            self._begin_anew()

    def hear_source(
        self, name: str, entries: Entries, stamp: float, now: Now, frame: str = ""
    ) -> bool:
        """Take what a source shows from now on; return whether it differs from before.

        A scan counts only where odometry, as it is now, says where the robot was.

        Args:
            name: of the source.
            entries: what its message became; of a scan, in the robot's axes.
            stamp: of the message [s].
            now: the present.
            frame: of the message.
        """
        source = self.sources[name]
        if source.settings.type == "scan":
            return self._hear_scan(source, entries, stamp, now, frame)
        stamp = min(stamp, now.ros)  # what came last counts: stamps may be fixed, or another's
        if stamp <= source.watch.stamp:
            source.watch.forget()
        if not source.watch.hear(stamp, now, frame, self.frame_of(source.settings)):
            return False
        before, source.entries = source.entries, entries
        differs = not sources.are_same(before, entries)
        if differs:
            self._show()
        return differs

    def _hear_scan(
        self, source: Source, entries: Entries, stamp: float, now: Now, frame: str
    ) -> bool:
        """Take a scan (see `hear_source`); return whether it is believed."""
        newest = self.localization.newest
        if newest is not None and not self.settings.base_shift_correction:
            pose = newest.local
        else:
            pose = self.localization.at(stamp)
        expected = self.frame_of(source.settings)
        if pose is None or not source.watch.hear(stamp, now, frame, expected):
            return False
        source.measured = Measured(entries, pose, min(stamp, now.ros))
        self._frame = None  # it lies nowhere yet
        if newest is not None:
            self._place_scans(newest.frame)
        return True

    def refuse_source(self, name: str, says: str) -> None:
        """Note that a source's newest message is faulty."""
        self.sources[name].watch.refuse(says)

    def change(self, given: Mapping[str, Any]) -> None:
        """Take parameters that may change while the node runs: all of them, or none.

        Args:
            given: name → value; names that are not the node's are passed over.

        Raises:
            InvalidInputError: if one does not fit, or may not change now.
        """
        known = by_name(list(self.sources))
        values = {name: known[name].live_value(one, name) for name, one in given.items()
                  if name in known}  # fmt: skip
        if "v_max" in values:  # the only one that may still be refused
            self.set_v_max(values.pop("v_max"))
        self.enabled = values.pop("enabled", self.enabled)
        for name, enabled in values.items():
            self.enable_source(name.split(".")[0], enabled)

    def enable_source(self, name: str, enabled: bool) -> None:
        """Let a source count, or not."""
        source = self.sources[name]
        if enabled != source.enabled:
            source.enabled = enabled
            self._led.ask()
            self._show()

    def frame_of(self, source: SourceSettings) -> str:
        """Return the frame that a source's messages must have."""
        usual = self.settings.base_frame_id if source.type == "scan" else ""
        return source.frame_id or usual or self.settings.global_frame_id

    def set_v_max(self, v_max: float) -> None:
        """Set the strict cap on the speed [m/s], 0 for none.

        Raises:
            InvalidInputError: if it leaves no speed.
        """
        self._filter.v_max = v_max or None
        self.settings = replace(self.settings, v_max=v_max)

    # -- what is prepared beside ------------------------------------------------------------------

    def of_scan(
        self, name: str, beams: Beams, mount: ArrayLike | None = None, stamp: float | None = None
    ) -> Entries:
        """Return what a scan shows in the robot's axes at its stamp.

        Each beam counts from where the robot was at the time of that beam.

        Args:
            name: of the source.
            beams: the scan.
            mount: (3,) of the sensor on the robot; None takes the parameter.
            stamp: of the first beam [s]; None for beams of one time.

        Raises:
            InvalidInputError: if it cannot be accepted, or odometry does not say where the robot
                was at each beam.
        """
        settings = self.sources[name].settings
        x, y, yaw = np.asarray(settings.mount if mount is None else mount).tolist()
        horizon = self._filter.horizon + math.hypot(x, y)
        horizon += settings.obstacle_speed * self.sources[name].watch.timeout  # as it becomes older
        sweep = beams.sweep
        path = None if stamp is None or sweep == 0.0 else self.localization.path(stamp, sweep)
        return sources.of_scan(settings, beams, (x, y, yaw), horizon, path)

    def of_grid(
        self, name: str, raster: Raster, limits: Mapping[str, object] | None = None
    ) -> Entries:
        """Return what an occupancy grid shows.

        Args:
            name: of the source.
            raster: the grid.
            limits: what replaces parameters, such as base and multiplier.

        Raises:
            InvalidInputError: if its values make no classes, or a limit is too low to be kept.
        """
        source = self.sources[name]
        settings = replace(source.settings, **(limits or {}))
        shown = sources.of_grid(settings, raster, self.fastest, source.entries)
        if settings.type == "speed":
            self._filter.check(shown)
        return shown

    def planned(self, goal: ArrayLike | None) -> VelocityFilter:
        """Return a filter that leads to a goal, its field computed; hand it over by `take`.

        Args:
            goal: (2,) [m]; None for a filter that leads nowhere.

        Raises:
            InvalidInputError: if no way leads there.
        """
        made = filters.made(self._filter.robot, self.settings, self._shown, goal)
        if goal is not None:
            newest = self.localization.newest
            if newest is None:
                raise InvalidInputError("goal: there is no pose yet, expected odometry first")
            still = np.zeros(self._size)
            _, report = made.step(
                still, newest.local, newest.twist, newest.stamp, frame=newest.frame
            )
            if report["reason"] == Reason.GOAL:
                raise InvalidInputError(made.lost)
            if report["reason"] == Reason.BARRIERS:
                raise InvalidInputError(
                    f"goal: got {np.asarray(goal).tolist()}, expected barriers that are believed"
                )
        return made

    @property
    def is_localized(self) -> bool:
        """Whether a pose has come, so that a goal can be `planned`."""
        return self.localization.newest is not None

    def wait(self, goal: ArrayLike) -> None:
        """Let a goal (2,) [m] wait for the first pose; then `goal_to_plan` returns it."""
        self._led.wait(finite_array("goal", goal, (2,)))

    def take(self, planned: VelocityFilter) -> None:
        """Go on with a filter that was `planned`."""
        self._led.take(planned, self.settings.v_max)
        self._show()

    @property
    def goal(self) -> Array | None:
        """(2,) where guidance leads, or will again [m]."""
        return self._led.goal

    def goal_to_plan(self) -> Array | None:
        """Return the goal that must be `planned` again, once; None where none must."""
        return None if self._last is None else self._led.goal_to_plan()  # None: a fault

    # -- what is decided --------------------------------------------------------------------------

    def step(self, now: Now) -> Decision:
        """Decide what the robot is told now."""
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
            says, zero = "; ".join(map(str, faults)), np.zeros(self._size)
            decision = Decision(zero, self._wanted, Level.ERROR, says, Action.STOP, "filter", None)
            self._begin_anew()
        self._last = None if faults else (now.ros, decision)
        return self._silenced(decision, now)

    def _faults(self, now: Now) -> list[Fault | None]:
        """Return what keeps the robot at zero, the gravest first."""
        found = [self._clock.fault(now), *self.localization.faults(now)]
        if self._alarm is not None and now.steady >= self._alarm[0]:
            self._alarm = None
        if self._alarm is not None:
            found.append(self._alarm[1])
        found += [one.watch.fault(now) for one in self.sources.values() if one.enabled]
        found.append(self._command.fault(now))
        return found

    def _filtered(self, now: Now) -> Decision:
        """Return what the filter says."""
        last = self.localization.newest
        if last is None:  # the newest message has jumped
            return self._stopped([Fault("odometry", "nothing received")], now)
        self._place_scans(last.frame)
        x = np.array([*last.pose[:2], 0.0, 0.0])
        for source in self.sources.values():
            stops = source.enabled and source.settings.when_inside == "stop"
            if stops and sources.inside(source.entries, x, self._filter.robot.reach):
                return self._stopped([Fault(source.settings.name, INSIDE)], now)
        wanted = self._wanted
        stamp = min(last.stamp, now.ros)  # by no more than the tolerance ahead
        told, report = self._filter.step(wanted, last.local, last.twist, stamp, now.ros, last.frame)
        status, reason = FilterStatus(int(report["status"])), Reason(int(report["reason"]))
        if reason.lasts:
            fault = Fault("robot", reason.says)
            self._alarm = now.steady + self.settings.alarm_pause, fault
            self._begin_anew()
            return self._stopped([fault], now)
        if status == FilterStatus.BACKUP:
            why = f": {self._filter.lost}" if reason == Reason.GOAL else ""
            says = f"filter: {reason.says}{why}"
            return Decision(told, wanted, Level.ERROR, says, Action.STOP, "filter", report)
        if status <= FilterStatus.SAFE:
            level = Level.OK
        else:
            level = Level.WARN if status == FilterStatus.RELAXED else Level.ERROR
        changed = report["intervention"] > 1e-3
        name = self._nearest(report) if changed or status > FilterStatus.SAFE else ""
        says = f"{status.name}{': ' + name if name else ''}"
        action = Action.LIMIT if changed else Action.DO_NOTHING
        return Decision(told, wanted, level, says, action, name if changed else "", report)

    def _nearest(self, report: Info) -> str:
        """Return what pays most, or else what is nearest after its margin."""
        if not self._names:
            return ""
        paid = report["slack"][: len(self._names)]
        if paid.size and paid.max() > 0.0:
            return self._names[int(np.argmax(paid))]
        left = (report["h"] - report["margin"])[: len(self._names)]
        return self._names[int(np.argmin(left))] if np.isfinite(left).any() else ""

    def _stopped(self, faults: list[Fault], now: Now) -> Decision:
        """Return zero, and let the filter know that the robot is told so."""
        zero, report = np.zeros(self._size), None
        if math.isfinite(now.ros) and (self._last is None or now.ros > self._last[0]):
            _, report = self._filter.step(zero, None, None, math.nan, now.ros)
        says = "; ".join(map(str, faults))
        idle = [one.source for one in faults] == ["command"] and "old" in faults[0].says
        invalid = faults[0].source in self.sources and faults[0].says != INSIDE
        name = "invalid source" if invalid else faults[0].source
        level = Level.STALE if idle else Level.ERROR
        return Decision(zero, self._wanted, level, says, Action.STOP, name, report)

    def _passed(self, now: Now) -> Decision:
        """Return the velocity wanted as it is, while it is fresh: the node is not enabled."""
        fault = self._command.fault(now)
        told = self._wanted.copy() if fault is None else np.zeros(self._size)
        says = "not enabled" + (f"; {fault}" if fault else "")
        decision = Decision(told, self._wanted, Level.WARN, says, Action.DO_NOTHING, "", None)
        return self._silenced(decision, now)

    def _silenced(self, decision: Decision, now: Now) -> Decision:
        """Return the decision, without a command where zero has been said for long enough."""
        assert decision.command is not None
        if np.abs(decision.command).max() > ZERO:
            self._zero_since = None
            return decision
        if self._zero_since is None:
            self._zero_since = now.steady
        silent = now.steady - self._zero_since > self.settings.stop_pub_timeout
        return decision._replace(command=None) if silent else decision

    # -- what is remembered -----------------------------------------------------------------------

    def _begin_anew(self) -> None:
        """Let the filter forget the past."""
        if self._led.begin_anew(self.settings.v_max):
            self._show()

    def _forget(self) -> None:
        """Begin anew: the clock has gone back, and no stamp from before means anything."""
        self._command.forget()
        self.localization.forget()
        for source in self.sources.values():
            if source.settings.type == "scan":
                source.watch.forget()
            elif source.watch.is_known:
                source.watch.stand()
        self._last = None
        self._begin_anew()

    def _place_scans(self, frame: Array) -> None:
        """Let scans lie by odometry, wherever its frame (3,) is now [m, rad].

        So what corrects the pose moves them, too: it is the robot's own place that was wrong, and
        not how far away it saw something.
        """
        if self._frame is not None and np.array_equal(frame, self._frame):
            return
        self._frame, scans = (
            frame,
            [one for one in self.sources.values() if one.measured is not None],
        )
        for source in scans:
            sources.place(source, frame)
        if scans:
            self._show()

    @property
    def _shown(self) -> list[Any]:
        """What the sources show now."""
        return [e for one in self.sources.values() if one.enabled for e in one.entries]

    def _show(self) -> None:
        """Hand the filter what the sources show; guidance looks at it in `planned` alone."""
        shown = self._shown
        self._names = [one.name for one in each(shown)]
        self._filter.set_barriers(shown, look=False)
