"""The filter for a loop of the user's own: a robot that takes velocities, without Gymnasium."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers import braking
from hcbf_gym.barriers.many import Element
from hcbf_gym.barriers.set import BarrierSet, Condition
from hcbf_gym.errors import (
    InvalidInputError,
    SafetyWarning,
    finite_array,
    finite_float,
    floats,
    instance,
    warn_caller,
)
from hcbf_gym.filter.core import FilterCore
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models import clocks
from hcbf_gym.models.plant import Coverage, Estimate
from hcbf_gym.programs import ConflictReport, FilterStatus
from hcbf_robots.maps.scan import Scan
from hcbf_robots.online.barrier_input import BarrierInput
from hcbf_robots.online.follower import Follower
from hcbf_robots.online.odometry import Odometry
from hcbf_robots.online.robot import Robot, alpha1_of, known_of, plant_of
from hcbf_robots.online.sample import Sample, frame_of, number, placed, sample_of
from hcbf_robots.online.step_times import StepTimes

if TYPE_CHECKING:
    from hcbf_gym.certificates import Certificate
    from hcbf_robots.walkers.walker import Walker

UNKNOWN = np.full(3, np.nan)
"""A frame that is not given."""


class PresentState(NamedTuple):
    """The robot at the present, by its newest sample."""

    estimate: Estimate  # of the point that follows commands, for the filter's core
    heading: float  # [rad]
    turning: float  # the turning rate [rad/s]
    is_valid: bool  # whether the sample is finite and new enough


class VelocityFilter:
    """Filters every velocity command of a robot through one of the programs.

    In every period the user passes the nominal command, pose and twist, and sends the result to the
    robot. Data that are old or not finite are not accepted: the command is zero at once, until
    there are valid data again. With `now`, data may be repeated or come out of their order: the
    newest are propagated to it by the commands since then, or by their twist where the robot's
    response was not measured, and rows reserve the error of that.

    One thread at a time may call a filter: where odometry and commands come in several threads,
    store the newest odometry and call `step` in the thread of the commands, or under a lock.

    Args:
        robot: a contract's path or name, see `Walker.load`; a `Walker`; or a `Robot`.
        barriers: the ranked conditions on the robot's position, in the frame of the pose, also in
            survey coordinates. A shape that moves is where it is put at the first step since it was
            set; `set_barriers` takes another time. Functions of time count from the first step
            since the reset. It may be set at any time, as `goal`, `v_max` and `program`.
        program: a name from `hcbf_gym.programs.names()` that is compiled.
        period: the longest regular time between two calls [s]; shorter ones do no harm. A command
            is good for that long.
        goal: (2,) where guidance leads [m]; None without guidance.
        guidance: as `wrappers.SafetyFilter` takes it.
        v_max: strict cap on the speed [m/s]; None for none but the greatest command. Its row
            reserves m for an overshoot and one input of `period` T besides, so that commands are at
            most ``√(v_max² − 2 v_max m − (T u_max)²)``, which is `fastest`.
        radius: of the circle around the robot's centre, or a cart's axle, that holds it [m]; None
            takes the robot's reach, which that of legs counts by their stride.
        max_age: the greatest age of data that are accepted [s]; a stamp may be 0.1 s ahead.
        on_alarm: what an alarm leads to, "warn" or "brake": the robot does not follow its commands,
            or pose and twist do not fit (`docs/failing_closed.md`). It lasts until `reset`.
        margin: as `wrappers.SafetyFilter` takes it.
        certificate: rows reserve its margins, as `wrappers.SafetyFilter` takes it; `covered` stays
            0, as it is unknown here where the robot drives.
        **options: as `wrappers.SafetyFilter` takes them.

    Attributes:
        robot: the `Robot`, also of a contract.

    Raises:
        InvalidInputError: if an option is unknown or out of range, the barriers are invalid, no
            speed is left, or one period at full input passes the speed limit.
        UnknownNameError: if a name is not known; the message lists the choices.

    Examples:
        >>> from hcbf_gym.barriers import Disc
        >>> safe = VelocityFilter("cart", [Disc("pillar", 1, center=(2.0, 0.0), radius=0.5)])
        >>> command, report = safe.step((0.5, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)
        >>> command.shape, report["status"]
        ((2,), np.int64(1))
    """

    def __init__(
        self,
        robot: "str | Path | Walker | Robot",
        barriers: Sequence[Element],
        program: str = "lex-cbf-qp",
        period: float = 0.05,
        goal: ArrayLike | None = None,
        guidance: str | Mapping[str, object] | None = None,
        v_max: float | None = None,
        radius: float | None = None,
        max_age: float = 0.1,
        on_alarm: str = "warn",
        margin: float | None = None,
        certificate: "str | Path | Certificate | None" = None,
        **options: Any,
    ):
        self.robot = robot = known_of(robot)
        self._max_age = finite_float("max_age", max_age, minimum=0.0)
        self._period = finite_float("period", period, minimum=0.0, maximum=0.2, exclusive=True)
        reduced = self._reduced = plant_of(robot, self._period, radius, self._max_age, certificate)
        axle, able = reduced.plant.axle, braking.weakest(reduced.input_set)
        self._follower = Follower(robot, axle, reduced.response.follows, able, self._period)
        self._odometry = Odometry(robot, self._follower, reduced.strays, self._period)
        self._times = StepTimes(self._period)
        self._input = BarrierInput(self._times)
        self.v_max = v_max
        options = {"alpha1": alpha1_of(robot.command.fastest)} | options
        self._settings = FilterSettings(
            program, "held", guidance, margin, None, on_alarm, False, options
        )
        self._core = self._core_of(self._settings)
        self.barriers = barriers
        self._core.scenes.check(BarrierSet([self._input.with_limits(barriers)]))
        self.goal = goal
        self.reset()

    @property
    def barriers(self) -> Any:
        """The ranked conditions."""
        return self._input.barriers

    @barriers.setter
    def barriers(self, barriers: Sequence[Element]) -> None:
        self.set_barriers(barriers)

    def set_barriers(
        self, barriers: Sequence[Element], seen_at: float | None = None, *, look: bool = True
    ) -> None:
        """Take other barriers, such as what a tracker saw at its stamp.

        Args:
            barriers: as the class takes them.
            seen_at: when moving objects were where they are put, on the robot's clock [s]. A stamp
                that is more than 0.1 s ahead of a step or a minute behind it is not accepted: the
                command is zero. None is the next step for new objects; others continue.
            look: whether guidance takes them up in the next step, which may last longer then; False
                lets it lead as before.

        Raises:
            InvalidInputError: if `seen_at` is not finite.
        """
        self._input.set(barriers, seen_at, look)
        self._core.guide.follows = look
        self._warn_of_short_scans(barriers)

    def check(self, barriers: Sequence[Element]) -> None:
        """Refuse barriers, before they are set, for which a step would only brake.

        Raises:
            InvalidInputError: if they are invalid, or a speed zone's limit is lower than what its
                row reserves and one input brings.
        """
        self._core.scenes.check_limits(BarrierSet([self._input.with_limits(barriers)]))

    @property
    def conditions(self) -> list[Condition]:
        """Name and rank of the conditions in the order of the report's rows."""
        return self._core.conditions

    def conflict(self) -> ConflictReport | None:
        """Return which `conditions` no velocity met together at the last step, and who pays.

        None where there was no conflict, or the state was not accepted.
        """
        return self._core.conflict()

    @property
    def goal(self) -> Array | None:
        """(2,) where guidance leads [m]; None without guidance."""
        return self._goal

    @goal.setter
    def goal(self, goal: ArrayLike | None) -> None:
        position = None if goal is None else finite_array("goal", goal, (2,))
        guidance = self._settings.guidance
        if guidance is not None and position is None:
            raise InvalidInputError(
                f"goal: got None with guidance {guidance!r}, expected (x, y) where it leads [m]"
            )
        if position is not None:
            position.flags.writeable = False
        self._goal = position
        self._core.look_again()
        self._begun = False

    @property
    def lost(self) -> str:
        """Why guidance finds no path to the goal; "" where it finds one, or has not looked."""
        return self._core.lost

    @property
    def v_max(self) -> float | None:
        """Strict cap on the speed [m/s]; None for none but the greatest command."""
        limits = self._input.limits
        return limits[0].v_max if limits else None

    @v_max.setter
    def v_max(self, v_max: float | None) -> None:
        cap, follower = self._reduced.speed_cap(v_max, self._period), self._follower
        self._input.limits = cap.limits
        follower.begins_at, follower.fastest = cap.begins_at, cap.fastest

    @property
    def fastest(self) -> float:
        """The greatest commanded speed [m/s]."""
        return self._follower.fastest

    @property
    def horizon(self) -> float:
        """How far from its centre a robot must see a region, at the speed `fastest` [m]."""
        uncertainty = self._reduced.plant.uncertainty
        fastest = self.fastest + self._reduced.hardest * self._period
        distance = self._core.config.alpha1.inverse(fastest) + fastest * self._period
        return distance + uncertainty.distance + uncertainty.cap + uncertainty.body

    def _warn_of_short_scans(self, barriers: object) -> None:
        """Warn of a scan that ends nearer than the robot must see."""
        for one in barriers if isinstance(barriers, Sequence) else ():
            if isinstance(one, Scan) and one.reach < (needed := self.horizon + one.reserved):
                warn_caller(
                    f"velocity filter: the scan {one.name!r} ends {one.reach:g} m away, where this "
                    f"robot must see {needed:.2g} m, expected Scan(reach=…) or a lower speed",
                    SafetyWarning,
                )

    @property
    def program(self) -> Any:
        """Name of the program."""
        return self._settings.program

    @program.setter
    def program(self, program: str) -> None:
        settings = self._settings._replace(program=program)
        core = self._core_of(settings)
        core.go_on_from(self._core)
        self._core, self._settings, self._begun = core, settings, False

    def _core_of(self, settings: FilterSettings) -> FilterCore:
        """Return the filter's core, which leaves the comparison of measurements to `Odometry`."""
        core = FilterCore(self._reduced.plant, self._reduced.input_set, settings)
        core.leave_monitor()
        core.guide.follows = self._input.guidance_follows
        return core

    def reset(self) -> None:
        """Forget the past: the robot is at rest anywhere, and time begins anew."""
        self._core.restart(np.ones(1, dtype=np.bool_))
        for part in (self._times, self._input, self._follower, self._odometry):
            part.forget()
        self._filtered: object = None  # the barriers of the last step
        self._begun = self._is_framed = False

    def go_on_from(self, other: "VelocityFilter") -> None:
        """Take the place and the state of another filter of the same robot.

        So a filter can be made beside a loop, and look at goal and barriers in a first step there.
        The other must not be used any more.

        Raises:
            InvalidInputError: if the other's robot takes other commands or follows otherwise.
        """
        mine, its = self.robot, instance("other", other, VelocityFilter).robot
        if (its.command, its.response) != (mine.command, mine.response):
            raise InvalidInputError(f"other: got a filter of {its}, expected one of {mine}")
        self._follower.go_on_from(other._follower)
        self._odometry.go_on_from(other._odometry)
        self._times.go_on_from(other._times)
        self._is_framed = other._is_framed
        if self._core.go_on_from(other._core):
            self._begun = False

    def step(
        self,
        command: ArrayLike,
        pose: ArrayLike | None,
        twist: ArrayLike | None,
        time: float,
        now: float | None = None,
        frame: ArrayLike | None = None,
    ) -> tuple[Array, Info]:
        """Return the filtered command, and its report.

        Args:
            command: the nominal one, in the robot's axes: (v_x, v_y, ω), or (v, ω) of a
                differential drive [m/s, rad/s].
            pose: (x, y, θ) of its centre in `frame` [m, rad]; None where there is none. It is
                smooth, as odometry is: commands are compared with it.
            twist: (v_x, v_y, ω) of its centre, in the robot's axes [m/s, rad/s]; None where there
                is none.
            time: at which pose and twist were measured [s].
            now: the present on the same clock, from which their age counts [s]; None is `time`.
            frame: (x, y, θ) of the pose's frame in the barriers' [m, rad], as tf has ``map`` →
                ``odom``; it may jump where a localization corrects it. None where they are one;
                where one was given since the reset, None is unknown: the command is zero.

        Returns:
            The command in the robot's axes, in the given precision (32 or 64 bits), and a dict as
            ``info["safety_filter"]`` has it, with `valid_until` besides: the time from which on the
            command is zero unless there is another.

        Raises:
            InvalidInputError: if the command is not made of finite numbers; then nothing has
                happened.
        """
        follower, times = self._follower, self._times
        dtype = floats("command", command, (len(follower.limits),)).dtype
        wanted = finite_array("command", command, (len(follower.limits),))
        given = sample_of(pose, twist, time)
        sample = given if now is None else self._odometry.newest(given, number(now))
        present = given.stamp if now is None else number(now)
        self._note_present(present)
        self._is_framed = self._is_framed or frame is not None
        correction = frame_of(frame) if frame is not None or not self._is_framed else UNKNOWN
        age = 0.0 if now is None else present - sample.stamp
        is_new = sample.place is given.place
        state = self._state_at(present, sample, correction, age, is_new=is_new)
        barriers = self._begin(self._input.scene(), state, present)
        estimate = state.estimate._replace(elapsed=times.elapsed(present))
        velocity = estimate.x[2:]
        nominal = follower.nominal(wanted, state.heading, velocity)
        u, report = self._core.step(nominal, barriers, estimate, self._input.since)
        self._filtered = barriers
        if report["status"] == FilterStatus.BACKUP:
            times.accepted_at, out = None, follower.stop()
        else:
            times.accepted_at = present
            follower.follow(velocity, u, state.heading, present)
            out = follower.command(wanted, state.heading, state.turning)
        out = out.astype(dtype).astype(np.float64)  # the numbers that the robot gets
        self._odometry.note_command(out, present)
        times.note_command(present)
        report["valid_until"] = np.float64(times.valid_until)
        return out.astype(dtype), report

    def _note_present(self, present: float) -> None:
        """Begin anew if the clock goes back to the present [s]; note samples that are missing."""
        if self._times.note_present(present):
            self._core.join(np.ones(1, dtype=np.bool_))
            self._odometry.compare_anew()
            self._follower.pause()
            self._begun = False
        self._input.check_stamp(present)
        self._core.scenes.scan_ages.clock_zero = self._times.zero
        if self._times.is_missing(present):
            self._miss()

    def _state_at(
        self, present: float, sample: Sample, correction: Array, age: float, *, is_new: bool
    ) -> PresentState:
        """Return the robot's state at the present, to which an older sample is propagated.

        Args:
            present: the time of the step [s].
            sample: the newest pose and twist.
            correction: (3,) the pose's frame in the barriers' [m, rad]; NaN if it is unknown.
            age: of the sample [s].
            is_new: whether this step is the first with the sample.
        """
        follower, odometry = self._follower, self._odometry
        motion = sample.motion
        place = placed(correction, sample.place)
        is_finite = bool(np.isfinite(place.sum() + motion.sum() + present + age))
        if is_finite and is_new:
            odometry.watch(sample)
        if is_finite:
            follower.turn(correction[2])
        is_valid = is_finite and bool(clocks.is_accepted(age, self._max_age))
        if is_valid and age > 0.0:
            place, motion = odometry.propagated(place, motion, sample.stamp, present)
        body = follower.measured(place, motion)
        velocity = follower.velocity
        if is_finite:
            velocity = follower.now(body[2:], place[2], present)
        x = np.array([body[0], body[1], *velocity])
        lag = np.array([0.0, 0.0, *(body[2:] - velocity)])
        covariance = odometry.covariance(self._core.config.uncertainty)
        time, fault = present - self._times.zero, odometry.fault or None
        estimate = Estimate(x, time, covariance, x, lag, place[2], age=age, fault=fault)
        return PresentState(estimate, float(place[2]), float(motion[2]), is_valid)

    def _begin(self, barriers: object, state: PresentState, present: float) -> object:
        """Begin an episode, or let guidance look at new barriers, where that is due.

        Returns:
            The barriers, or None if no episode can begin with them.
        """
        begins = not self._begun and state.is_valid
        if begins:
            self._core.cover(Coverage.OUTSIDE)
        elif self._core.guides and self._input.guidance_is_due(present):
            self._core.look_again()
        else:
            return barriers
        self._input.note_guidance(present)
        try:
            self._core.begin(barriers, state.estimate, self._goal, None, self._input.since)
            self._begun = self._begun or begins
        except InvalidInputError as error:
            as_before = "" if begins else "; guidance leads as before"
            warn_caller(f"velocity filter: {error}{as_before}", SafetyWarning)
            return None if begins else barriers
        return barriers

    def _miss(self) -> None:
        """Filter once without a sample: the robot's motion since the last one is unknown."""
        last = self._times.accepted_at
        time = None if last is None else last - self._times.zero
        missing = Estimate(np.zeros(4), time, heading=0.0, age=math.inf)
        self._core.step(np.zeros(2), self._filtered, missing, self._input.since)
        self._follower.stop()
        self._times.accepted_at = None

    def command_at(self, now: float) -> Array:
        """Return the command at a time [s]: the last one while it is valid, else zero.

        It serves loops that send commands more often than data come. Before the last sample's time,
        where a clock has gone back, it is zero, too.
        """
        if self._times.is_valid_at(number(now)):
            return self._odometry.command.copy()
        return np.zeros(len(self._follower.limits))
