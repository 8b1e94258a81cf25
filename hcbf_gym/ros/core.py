"""All that the node decides, without ROS: from what was heard and two clocks to a velocity.

The node calls `hear_…` for messages and `step` when a velocity is wanted, or a period has passed.
A fault is zero at once, with its reason; when it has gone, the filter goes on by itself.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array
from hcbf_gym.barriers.set import each
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.maps.nav2 import Raster
from hcbf_gym.models.constants import FARTHEST
from hcbf_gym.models.plant import FIRST_ALARM, Reason
from hcbf_gym.online import Command, Response, Robot, VelocityFilter
from hcbf_gym.programs import FilterStatus
from hcbf_gym.ros import sources
from hcbf_gym.ros.parameters import ZONES, Settings, SourceSettings
from hcbf_gym.ros.sources import Beams, Entries
from hcbf_gym.ros.watches import ClockWatch, Fault, Now, Watch

HELD = 1.3
"""Periods of the node for which the filter's rows hold: timers and messages jitter."""
REMEMBERED = 3.0
"""How long poses are kept, to place scans [s]."""
TURN_JUMP = 0.5
"""By which a yaw may differ from what the twist says [rad]."""
FROZEN_PATH, FROZEN_WITHIN = 0.05, 1e-3
"""A pose is frozen that stays within a millimetre while the twist makes 5 cm in about a second."""
INSIDE = "the robot is inside"
ZERO = 1e-9
"""A velocity below it is zero, as in the collision monitor."""


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
    report: dict[str, Any] | None


class Odometry(NamedTuple):
    """Where the robot was.

    Attributes:
        stamp: when [s].
        pose: (3,) x, y [m] and yaw [rad] in the global frame.
        twist: (3,) v_x, v_y [m/s] and ω [rad/s] in its own axes.
    """

    stamp: float
    pose: Array
    twist: Array


@dataclass
class Source:
    """What is known of one source.

    Attributes:
        settings: its parameters.
        watch: over its messages.
        entries: what it has shown.
    """

    settings: SourceSettings
    watch: Watch
    entries: Entries = ()
    enabled: bool = field(init=False)

    def __post_init__(self) -> None:
        self.enabled = self.settings.enabled


class NodeCore:
    """Decides what the robot is told. All compiled code is compiled when the constructor returns.

    `of_scan`, `of_grid`, `planned` and what else prepares may run in another thread than the rest;
    what they return is handed over by `hear_source` and `take`.

    Args:
        settings: the node's parameters.

    Raises:
        InvalidInputError: if a file cannot be read, or robot, program and speeds do not go
            together.

    Attributes:
        sources: name → what is known of it.
    """

    def __init__(self, settings: Settings):
        self.settings = settings
        self.enabled = settings.enabled
        tolerance = settings.transform_tolerance
        self._command = Watch("command", settings.cmd_vel_timeout, tolerance)
        self._odometry = Watch("odometry", settings.odom_timeout, tolerance)
        self._pose = Watch("pose", 0.0, tolerance)
        self._clock = ClockWatch(settings.clock_timeout)
        self.sources = {
            one.name: Source(one, Watch(one.name, _timeout(one, settings), tolerance))
            for one in settings.sources
        }
        self._filter = _warmed(settings)
        self._size = len(self._filter.robot.command.limits)
        self._wanted = np.zeros(self._size)
        for one in self.sources.values():
            self._begin(one)
        self._track: deque[Odometry] = deque(maxlen=1024)
        self._local: deque[Odometry] = deque(maxlen=1024)  # as odometry has them
        needs = settings.pose_source != "odom"
        self._correction: Array | None = None if needs else np.zeros(3)
        self._jump: tuple[float, Fault] | None = None  # until when it settles [steady s]
        self._alarm: tuple[float, Fault] | None = None
        self._zero_since: float | None = None
        self._last: tuple[float, Decision] | None = None
        self._goal: Array | None = None
        self._names: list[str] = []
        self._still, self._still_path = np.full(2, np.inf), 0.0
        self._show()

    def _begin(self, source: Source) -> None:
        """Let a source show what no message has to say: a file, or a zone of the parameters."""
        one = source.settings
        if one.file:
            source.entries = sources.of_grid(one, sources.of_file(one), self.fastest)
        elif one.type == "polygon":
            source.entries = sources.of_polygon(one, one.points)
        elif one.type == "circle" and one.center:
            source.entries = sources.of_circle(one, one.center, one.radius)
        if one.file or one.type in ZONES:
            source.watch.stand()

    @property
    def fastest(self) -> float:
        """The greatest speed that the robot is told [m/s]."""
        return self._filter.fastest

    @property
    def place(self) -> Array:
        """(3,) the newest pose in the global frame [m, rad]; zeros where there is none."""
        return self._track[-1].pose if self._track else np.zeros(3)

    # -- what is heard ----------------------------------------------------------------------------

    def hear_command(
        self, command: ArrayLike, now: Now, stamp: float | None = None, frame: str = ""
    ) -> None:
        """Take the velocity wanted: v_x, v_y [m/s] and ω [rad/s] in the robot's axes.

        Args:
            command: (3,).
            now: the present.
            stamp: of the message [s]; None where it has none.
            frame: likewise; "" for the robot's.
        """
        self._clock.see(now)
        given = np.asarray(command, dtype=np.float64)
        expected = self.settings.base_frame_id if frame else ""
        if not np.isfinite(given).all():
            self._command.refuse(f"got {given.tolist()}, expected finite numbers")
        elif stamp is None:
            self._command.forget()  # without a stamp the newest is the last that came
            self._command.hear(now.ros, now)
            self._wanted = given[[0, 2]] if self._size == 2 else given
        elif self._command.hear(stamp, now, frame, expected):
            self._wanted = given[[0, 2]] if self._size == 2 else given

    def hear_odometry(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        stamp: float,
        now: Now,
        frame: str = "",
        child: str = "",
    ) -> None:
        """Take the odometry: x, y, yaw in its own frame, v_x, v_y, ω in the robot's axes."""
        self._clock.see(now)
        place, motion = np.asarray(pose, dtype=np.float64), np.asarray(twist, dtype=np.float64)
        watch, settings = self._odometry, self.settings
        if child and child != settings.base_frame_id:
            watch.refuse(f"child frame {child!r}, expected {settings.base_frame_id!r}")
        elif not _plausible(place) or not _plausible(motion):
            watch.refuse(f"got {[*place.tolist(), *motion.tolist()]}, expected finite numbers")
        elif watch.hear(stamp, now, frame, settings.odom_frame_id):
            self._local.append(Odometry(stamp, place, motion))
            if self._correction is not None:
                self._follow(Odometry(stamp, _placed(self._correction, place), motion), now)

    def hear_pose(self, pose: ArrayLike, stamp: float, now: Now, frame: str = "") -> None:
        """Take where the robot was in the global frame: odometry goes on from there."""
        given = np.asarray(pose, dtype=np.float64)
        if not _plausible(given):
            self._pose.refuse(f"got {given.tolist()}, expected finite numbers")
        elif self._pose.hear(stamp, now, frame, self.settings.global_frame_id):
            local = _at(self._local, stamp)
            if local is None:
                self._pose.refuse("there is no odometry of that time")
            else:
                self._correction = _between(local, given)

    def hear_correction(self, correction: ArrayLike | None) -> None:
        """Take the odometry's frame in the global one, (x, y, yaw), as tf has it; None: unknown."""
        given = np.full(3, np.nan) if correction is None else np.asarray(correction, dtype=float)
        if _plausible(given):
            self._correction = given
        else:
            self._correction = None
            self._pose.refuse("tf has no transform to the odometry's frame")

    def hear_source(
        self, name: str, entries: Entries, stamp: float, now: Now, frame: str = ""
    ) -> None:
        """Take what a source shows from now on.

        Args:
            name: of the source.
            entries: what its message became.
            stamp: of the message [s].
            now: the present.
            frame: of the message.
        """
        source = self.sources[name]
        if source.watch.hear(stamp, now, frame, self.frame_of(source.settings)):
            before, source.entries = source.entries, entries
            if list(map(id, before)) != list(map(id, entries)):
                self._show()

    def refuse_source(self, name: str, says: str) -> None:
        """Note that a source's newest message is faulty."""
        self.sources[name].watch.refuse(says)

    def enable_source(self, name: str, enabled: bool) -> None:
        """Let a source count, or not."""
        self.sources[name].enabled = enabled
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
        self, name: str, beams: Beams, stamp: float, mount: ArrayLike | None = None
    ) -> Entries | None:
        """Return what a scan shows; None where nobody knows where the robot was.

        Args:
            name: of the source.
            beams: the scan.
            stamp: when it was measured [s].
            mount: (3,) of the sensor on the robot; None takes the parameter.

        Raises:
            InvalidInputError: if it cannot be believed.
        """
        settings = self.sources[name].settings
        track = self._track.copy()
        if not self.settings.base_shift_correction:
            stamp = track[-1].stamp if track else stamp
        pose = _at(track, stamp)
        if pose is None:
            return None
        x, y, yaw = _placed(pose, np.asarray(settings.mount if mount is None else mount)).tolist()
        return sources.of_scan(settings, beams, (x, y, yaw))

    def of_grid(
        self, name: str, raster: Raster, limits: Mapping[str, Any] | None = None
    ) -> Entries:
        """Return what an occupancy grid shows.

        Args:
            name: of the source.
            raster: the grid.
            limits: what replaces parameters, such as base and multiplier.

        Raises:
            InvalidInputError: if its values make no classes.
        """
        source = self.sources[name]
        settings = replace(source.settings, **(limits or {}))
        return sources.of_grid(settings, raster, self.fastest, source.entries)

    def planned(self, goal: ArrayLike | None, changed: Mapping[str, Entries] | None = None) -> Any:
        """Return a filter that leads to a goal, its field computed; hand it over by `take`.

        Args:
            goal: (2,) [m]; None for a filter that leads nowhere.
            changed: name → what sources will show.

        Raises:
            InvalidInputError: if no way leads there.
        """
        entries = {name: one.entries for name, one in self.sources.items() if one.enabled}
        scene = [one for shown in (entries | dict(changed or {})).values() for one in shown]
        made = _filter(self._filter.robot, self.settings, scene, goal)
        if goal is not None:
            if not self._track:
                raise InvalidInputError("goal: there is no pose yet, expected odometry first")
            last = self._track[-1]
            _, report = made.step(np.zeros(self._size), last.pose, last.twist, last.stamp)
            if report["reason"] == Reason.BARRIERS:
                raise InvalidInputError(
                    f"goal: got {np.asarray(goal).tolist()}, expected a goal that can be reached"
                )
        return made

    def take(self, planned: Any) -> None:
        """Go on with a filter that was `planned`."""
        self._filter, self._goal = planned, planned.goal
        self._show()

    @property
    def goal(self) -> Array | None:
        """(2,) where guidance leads [m]."""
        return self._goal

    # -- what is decided --------------------------------------------------------------------------

    def step(self, now: Now) -> Decision:
        """Decide what the robot is told now."""
        self._clock.see(now)
        back = self._clock.went_back()
        if back is not None:
            self._forget()
        if not self.enabled:
            return self._passed(now)
        faults = [one for one in (back, *self._faults(now)) if one is not None]
        if not faults and self._last is not None and now.ros == self._last[0]:
            return self._silenced(self._last[1], now)  # a simulator's clock ticks more slowly
        decision = self._stopped(faults, now) if faults else self._filtered(now)
        self._last = None if faults else (now.ros, decision)
        return self._silenced(decision, now)

    def _faults(self, now: Now) -> list[Fault | None]:
        """Return what keeps the robot at zero, the gravest first."""
        found = [self._clock.fault(now), self._odometry.fault(now)]
        if self.settings.pose_source != "odom" and self._correction is None:
            found.append(self._pose.fault(now) or Fault("pose", "nothing received"))
        found.append(self._frozen())
        for name in ("_jump", "_alarm"):
            until = getattr(self, name)
            if until is not None and now.steady < until[0]:
                found.append(until[1])
            elif until is not None:
                setattr(self, name, None)
        found += [one.watch.fault(now) for one in self.sources.values() if one.enabled]
        found.append(self._command.fault(now))
        return found

    def _filtered(self, now: Now) -> Decision:
        """Return what the filter says."""
        last = self._track[-1]
        x = np.array([*last.pose[:2], 0.0, 0.0])
        for source in self.sources.values():
            stops = source.enabled and source.settings.when_inside == "stop"
            if stops and sources.inside(source.entries, x, self._filter.robot.reach):
                return self._stopped([Fault(source.settings.name, INSIDE)], now)
        wanted = self._wanted
        stamp = min(last.stamp, now.ros)  # by no more than the tolerance ahead
        told, report = self._filter.step(wanted, last.pose, last.twist, stamp, now.ros)
        status, reason = FilterStatus(int(report["status"])), Reason(int(report["reason"]))
        if reason >= FIRST_ALARM:
            fault = Fault("robot", reason.says)
            self._alarm = now.steady + self.settings.alarm_pause, fault
            self._filter.reset()
            return self._stopped([fault], now)
        if status == FilterStatus.BACKUP:
            says = f"filter: {reason.says}"
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

    def _nearest(self, report: dict[str, Any]) -> str:
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
            self._zero_since = now.steady if self._command.is_known else -math.inf
        silent = now.steady - self._zero_since > self.settings.stop_pub_timeout
        return decision._replace(command=None) if silent else decision

    # -- what is remembered -----------------------------------------------------------------------

    def _follow(self, newest: Odometry, now: Now) -> None:
        """Remember a pose, unless it jumps: then forget the others."""
        if self._track and 0.0 < newest.stamp - self._track[-1].stamp < 1.0:
            expected = _advanced(self._track[-1], newest.stamp, newest.twist)
            away = float(np.hypot(*(newest.pose - expected)[:2]))
            turned = abs(math.remainder(newest.pose[2] - expected[2], math.tau))
            if away > self.settings.pose_jump or turned > TURN_JUMP:
                says = f"the pose has jumped by {away:.2f} m and {turned:.2f} rad"
                self._jump = now.steady + self.settings.settle_time, Fault("odometry", says)
                self._track.clear()
                self._filter.reset()
        if np.abs(newest.pose[:2] - self._still).max() > FROZEN_WITHIN or not self._track:
            self._still, self._still_path = newest.pose[:2], 0.0
        else:
            seconds = min(newest.stamp - self._track[-1].stamp, 1.0)
            made = seconds * float(np.hypot(*newest.twist[:2]))
            self._still_path += made - seconds * self._still_path
        self._track.append(newest)
        while newest.stamp - self._track[0].stamp > REMEMBERED:
            self._track.popleft()

    def _frozen(self) -> Fault | None:
        """Return a fault where the pose stands although the twist says that the robot moves."""
        if self._still_path < FROZEN_PATH:
            return None
        return Fault("odometry", f"the pose stands while the twist makes {self._still_path:.2f} m")

    def _forget(self) -> None:
        """Begin anew: the clock has gone back, and no stamp from before means anything."""
        for watch in (self._command, self._odometry, self._pose):
            watch.forget()
        for source in self.sources.values():
            if source.settings.type == "scan":
                source.watch.forget()
            elif source.watch.is_known:
                source.watch.stand()
        self._track.clear()
        self._local.clear()
        self._last = None
        self._filter.reset()

    def _show(self) -> None:
        """Hand the filter what the sources show."""
        shown = [e for one in self.sources.values() if one.enabled for e in one.entries]
        self._names = [one.name for one in each(shown)]
        self._filter.barriers = shown


def robot_of(settings: Settings) -> str | Robot:
    """Return the robot that parameters describe.

    Raises:
        InvalidInputError: if its response cannot be read, or its numbers do not fit.
    """
    if settings.robot:
        return settings.robot
    command = Command(
        settings.max_forward,
        settings.max_turn,
        settings.max_sideways or None,
        settings.look_ahead or None,
    )
    response = Response.load(Path(settings.response_file)) if settings.response_file else None
    return Robot(command, response, settings.reach)


def _filter(robot: str | Robot, settings: Settings, scene: Any, goal: Any) -> VelocityFilter:
    """Return a filter as the parameters ask for it."""
    return VelocityFilter(
        robot,
        scene,
        settings.program,
        period=HELD * settings.period,
        goal=goal,
        guidance=settings.guidance or None if goal is not None else None,
        v_max=settings.v_max or None,
        max_age=settings.odom_timeout,
        on_alarm="brake",
    )


def _warmed(settings: Settings) -> VelocityFilter:
    """Return a filter with all compiled that its sources will need."""
    cells = np.zeros((40, 40), dtype=np.int16)
    cells[0] = 40
    again = cells.copy()
    cells[0, 0] = again[5, 5] = 100
    grid = sources.grid_of(0.1, (-2.0, -2.0, 0.0), 40, 40)
    scene: list[Any] = []
    for one in settings.sources:
        if one.is_grid:
            before = sources.of_grid(one, Raster(grid, cells), 100.0)
            shown = sources.of_grid(one, Raster(grid, again), 100.0, before)
        elif one.type == "scan":
            beams = Beams([1.5, math.inf], 0.0, 0.1, 0.0, 10.0)
            shown = sources.of_scan(one, beams, (0.0, 0.0, 0.0))
        elif one.type == "circle":
            shown = sources.of_circle(one, (1.5, 1.5), 0.1)
        else:
            shown = sources.of_polygon(one, [[1.4, 1.4], [1.6, 1.4], [1.5, 1.6]])
        sources.inside(shown, np.zeros(4), 0.0)
        scene += shown
    robot = robot_of(settings)
    made = _filter(robot, settings, scene, None)
    if settings.guidance:
        guided = _filter(made.robot, settings, scene, (0.5, 0.0))
        guided.step(guided.command_at(0.0), np.zeros(3), np.zeros(3), 0.0)
    made.barriers = []
    return made


def _timeout(source: SourceSettings, settings: Settings) -> float:
    """Return after how long a source is stale [s], 0 for never."""
    if source.source_timeout >= 0.0:
        return source.source_timeout
    return settings.source_timeout if source.type == "scan" else 0.0


def _plausible(numbers: Array) -> bool:
    """Return whether numbers are finite, and none is farther than anything is."""
    return bool(np.isfinite(numbers).all() and np.abs(numbers).max() <= FARTHEST)


def _placed(frame: Array, pose: Array) -> Array:
    """Return a pose of a frame (x, y, yaw) in that frame's own parent."""
    cos, sin = math.cos(frame[2]), math.sin(frame[2])
    x, y, yaw = pose
    return np.array([frame[0] + cos * x - sin * y, frame[1] + sin * x + cos * y, frame[2] + yaw])


def _between(local: Array, pose: Array) -> Array:
    """Return the frame in which `local` is the pose `pose`."""
    yaw = pose[2] - local[2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y = local[:2]
    return np.array([pose[0] - cos * x + sin * y, pose[1] - sin * x - cos * y, yaw])


def _advanced(one: Odometry, stamp: float, twist: Array) -> Array:
    """Return (3,) where the mean of two twists brings a pose until a stamp [s]."""
    seconds, motion = stamp - one.stamp, 0.5 * (one.twist + twist)
    middle = np.array([*one.pose[:2], one.pose[2] + 0.5 * seconds * motion[2]])
    moved = _placed(middle, np.array([*(seconds * motion[:2]), 0.0]))
    return np.array([*moved[:2], one.pose[2] + seconds * motion[2]])


def _at(track: deque[Odometry], stamp: float) -> Array | None:
    """Return (3,) the pose at a stamp [s], None where the track does not reach so far."""
    later: Odometry | None = None
    for one in reversed(track):
        if one.stamp <= stamp:
            if later is None:
                return _advanced(one, stamp, one.twist) if stamp - one.stamp < 0.3 else None
            share = (stamp - one.stamp) / (later.stamp - one.stamp)
            turn = math.remainder(later.pose[2] - one.pose[2], math.tau)
            step = np.array([*(later.pose - one.pose)[:2], turn])
            return one.pose + share * step
        later = one
    if later is not None and later.stamp - stamp < 0.1:
        return _advanced(later, stamp, later.twist)
    return None
