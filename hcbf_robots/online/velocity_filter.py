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

UNKNOWN_FRAME = np.full(3, np.nan)


class PresentState(NamedTuple):
    """The robot's state at the present, by its newest sample."""

    estimate: Estimate  # of the reduced-order model, for the filter's core
    heading: float  # of the robot [rad]
    turning_rate: float  # of the robot [rad/s]
    is_valid: bool  # whether the sample is finite and new enough


class VelocityFilter:
    """Filters every velocity command of a robot through one of the programs.

    In every period the user passes the nominal command, pose and twist, and sends the result to the
    robot. Data that are old or not finite are not accepted: the command is zero at once, until
    there are valid data again. With `now`, data may be repeated or come out of their order. The
    newest are then propagated to `now` by the commands since their stamp, or by their twist if the
    robot's response was not measured. Rows reserve the error of this propagation.

    One thread at a time may call a filter: where odometry and commands come in several threads,
    store the newest odometry and call `step` in the thread of the commands, or under a lock.

    Args:
        robot: a contract's path or name, see `Walker.load`; a `Walker`; or a `Robot`.
        barriers: the ranked conditions on the robot's position, in the frame of the pose, also in
            survey coordinates. A moving shape has its given position at the first step after it
            was set; `set_barriers` takes another time. Functions of time count from the first step
            since the reset. It may be set at any time, as `goal`, `v_max` and `program`.
        program: a name from `hcbf_gym.programs.names()` that is compiled.
        period: the longest regular time between two calls [s]. A command is valid for that long.
        goal: (2,) where guidance leads [m]; None without guidance.
        guidance: as `wrappers.SafetyFilter` takes it.
        v_max: strict cap on the speed [m/s]; None for none but the greatest command. Its row
            reserves m for an overshoot and one input of `period` T besides, so that commands are at
            most ``√(v_max² − 2 v_max m − (T u_max)²)``, which is `fastest`.
        radius: of a circle around the robot's centre, or a cart's axle, that contains it [m]; None
            takes the robot's reach, which includes the stride of legs.
        max_age: the greatest age of data that are accepted [s]; a stamp may be 0.1 s ahead.
        on_alarm: "warn" or "brake", when the robot does not follow its commands or pose and twist
            do not fit (`docs/failing_closed.md`). An alarm lasts until `reset`.
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
        axle, u_max = reduced.plant.axle, braking.weakest(reduced.input_set)
        self._follower = Follower(robot, axle, reduced.response.follows, u_max, self._period)
        self._odometry = Odometry(robot, self._follower, reduced.max_acceleration, self._period)
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
            seen_at: time of the given positions of moving objects, on the robot's clock [s]. A
                stamp more than 0.1 s ahead of a step, or a minute behind it, is not accepted: the
                command is zero. None is the next step for new objects; others continue.
            look: whether guidance takes them up in the next step, which lasts longer then; False
                lets it lead as before.

        Raises:
            InvalidInputError: if `seen_at` is not finite.
        """
        self._input.set(barriers, seen_at, look)
        self._core.guide.follows = look
        self._warn_of_short_scans(barriers)

    def check(self, barriers: Sequence[Element]) -> None:
        """Refuse barriers with which every step would only brake; they are not set.

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
        """Return which `conditions` no velocity met together at the last step, and which yielded.

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
        self._has_begun = False

    @property
    def lost(self) -> str:
        """Why guidance finds no path to the goal; "" if it finds one, or has not searched."""
        return self._core.lost

    @property
    def v_max(self) -> float | None:
        """Strict cap on the speed [m/s]; None if only the greatest command limits it."""
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
        """Distance from its centre at which a robot must see regions, at `fastest` [m]."""
        uncertainty = self._reduced.plant.uncertainty
        fastest = self.fastest + self._reduced.max_deceleration * self._period
        distance = self._core.config.alpha1.inverse(fastest) + fastest * self._period
        return distance + uncertainty.distance + uncertainty.cap + uncertainty.body

    def _warn_of_short_scans(self, barriers: object) -> None:
        """Warn of a scan whose reach is shorter than the distance that the robot must see."""
        elements = barriers if isinstance(barriers, Sequence) else ()
        for scan in (element for element in elements if isinstance(element, Scan)):
            needed = self.horizon + scan.reserved
            if scan.reach < needed:
                warn_caller(
                    f"velocity filter: the scan {scan.name!r} ends {scan.reach:g} m away, where "
                    f"this robot must see {needed:.2g} m, expected Scan(reach=…) or a lower speed",
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
        self._core, self._settings, self._has_begun = core, settings, False

    def _core_of(self, settings: FilterSettings) -> FilterCore:
        """Return a core that leaves monitoring to `Odometry`, which compares measurements."""
        core = FilterCore(self._reduced.plant, self._reduced.input_set, settings)
        core.leave_monitor()
        core.guide.follows = self._input.guidance_follows
        return core

    def reset(self) -> None:
        """Forget the past: the robot may be at rest anywhere, and time begins again."""
        self._core.restart(np.ones(1, dtype=np.bool_))
        for part in (self._times, self._input, self._follower, self._odometry):
            part.forget()
        self._last_barriers: object = None  # of the last step
        self._has_begun = self._has_frame = False

    def go_on_from(self, other: "VelocityFilter") -> None:
        """Take the place and the state of another filter of the same robot.

        So a filter can be made in another thread, where its first step computes guidance's field.
        The other filter must not be used any more.

        Raises:
            InvalidInputError: if the other's robot takes other commands or follows otherwise.
        """
        robot, its_robot = self.robot, instance("other", other, VelocityFilter).robot
        if (its_robot.command, its_robot.response) != (robot.command, robot.response):
            raise InvalidInputError(f"other: got a filter of {its_robot}, expected one of {robot}")
        self._follower.go_on_from(other._follower)
        self._odometry.go_on_from(other._odometry)
        self._times.go_on_from(other._times)
        self._has_frame = other._has_frame
        if self._core.go_on_from(other._core):
            self._has_begun = False

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
        nominal = finite_array("command", command, (len(follower.limits),))
        given = sample_of(pose, twist, time)
        sample = given if now is None else self._odometry.newest(given, number(now))
        present = given.stamp if now is None else number(now)
        self._note_present(present)
        self._has_frame = self._has_frame or frame is not None
        is_frame_missing = frame is None and self._has_frame
        correction = UNKNOWN_FRAME if is_frame_missing else frame_of(frame)
        age = 0.0 if now is None else present - sample.stamp
        is_new = sample.pose is given.pose
        state = self._state_at(present, sample, correction, age, is_new=is_new)
        barriers = self._begin(self._input.scene(), state, present)
        estimate = state.estimate._replace(elapsed=times.elapsed(present))
        velocity = estimate.x[2:]
        nominal_input = follower.nominal_input(nominal, state.heading, velocity)
        u, report = self._core.step(nominal_input, barriers, estimate, self._input.since)
        self._last_barriers = barriers
        if report["status"] == FilterStatus.BACKUP:
            times.accepted_at, filtered = None, follower.stop()
        else:
            times.accepted_at = present
            follower.follow(velocity, u, state.heading, present)
            filtered = follower.command(nominal, state.heading, state.turning_rate)
        filtered = filtered.astype(dtype)
        # the monitor compares the robot with the command that it gets, rounded to 32 or 64 bits
        self._odometry.note_command(filtered.astype(np.float64), present)
        times.note_command(present)
        report["valid_until"] = np.float64(times.valid_until)
        return filtered, report

    def _note_present(self, present: float) -> None:
        """Restart if the clock goes back to the present [s]; step once for missing samples."""
        if self._times.note_present(present):
            self._core.join(np.ones(1, dtype=np.bool_))
            self._odometry.restart_monitor()
            self._follower.pause()
            self._has_begun = False
        self._input.check_stamp(present)
        self._core.scenes.scan_ages.clock_zero = self._times.zero
        if self._times.is_missing(present):
            self._step_without_sample()

    def _state_at(
        self, present: float, sample: Sample, correction: Array, age: float, *, is_new: bool
    ) -> PresentState:
        """Return the robot's state at the present, to which an older sample is propagated.

        Args:
            present: time of the step [s].
            sample: the newest pose and twist.
            correction: (3,) the pose's frame in the barriers' [m, rad]; NaN if it is unknown.
            age: of the sample [s].
            is_new: whether this step is the first with the sample.
        """
        follower, odometry = self._follower, self._odometry
        pose, twist = placed(correction, sample.pose), sample.twist
        is_finite = bool(np.isfinite(pose.sum() + twist.sum() + present + age))
        if is_finite and is_new:
            odometry.watch(sample)
        if is_finite:
            follower.set_frame_yaw(correction[2])
        is_valid = is_finite and bool(clocks.is_accepted(age, self._max_age))
        if is_valid and age > 0.0:
            pose, twist = odometry.propagated(pose, twist, sample.stamp, present)
        measured, velocity = follower.measured_state(pose, twist), follower.velocity
        if is_finite:
            velocity = follower.velocity_at(present, pose[2], measured[2:])
        x = np.array([measured[0], measured[1], *velocity])
        lag = np.array([0.0, 0.0, *(measured[2:] - velocity)])
        covariance = odometry.covariance(self._core.config.uncertainty)
        time, fault = present - self._times.zero, odometry.fault or None
        estimate = Estimate(x, time, covariance, x, lag, pose[2], age=age, fault=fault)
        return PresentState(estimate, float(pose[2]), float(twist[2]), is_valid)

    def _begin(self, barriers: object, state: PresentState, present: float) -> object:
        """Begin an episode, or let guidance take up new barriers, if one of them is due.

        Returns:
            The barriers, or None if no episode can begin with them.
        """
        begins = not self._has_begun and state.is_valid
        if begins:
            self._core.cover(Coverage.OUTSIDE)
        elif self._core.guides and self._input.guidance_is_due(present):
            self._core.look_again()
        else:
            return barriers
        self._input.note_guidance(present)
        try:
            self._core.begin(barriers, state.estimate, self._goal, None, self._input.since)
            self._has_begun = self._has_begun or begins
        except InvalidInputError as error:
            as_before = "" if begins else "; guidance leads as before"
            warn_caller(f"velocity filter: {error}{as_before}", SafetyWarning)
            return None if begins else barriers
        return barriers

    def _step_without_sample(self) -> None:
        """Let the core know that the robot's motion since the last sample is unknown."""
        last = self._times.accepted_at
        time = None if last is None else last - self._times.zero
        missing = Estimate(np.zeros(4), time, heading=0.0, age=math.inf)
        self._core.step(np.zeros(2), self._last_barriers, missing, self._input.since)
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
