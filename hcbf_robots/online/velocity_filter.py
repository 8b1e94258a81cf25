"""The filter for a loop of the user's own: a robot that takes velocities, without Gymnasium."""

import math
import operator
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import certificates
from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers import SpeedLimit, braking
from hcbf_gym.barriers.class_k import LogClassK
from hcbf_gym.barriers.many import Element, is_list
from hcbf_gym.barriers.set import BarrierSet, Condition
from hcbf_gym.errors import (
    CoverageWarning,
    InvalidInputError,
    SafetyWarning,
    finite_array,
    finite_float,
    flag,
    floats,
    instance,
    shown,
    warn_caller,
)
from hcbf_gym.filter.core import FilterCore
from hcbf_gym.filter.settings import FilterSettings
from hcbf_gym.models import clocks
from hcbf_gym.models.clocks import ROUNDING
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.plant import Coverage, Estimate, Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator
from hcbf_gym.programs import ConflictReport, FilterStatus
from hcbf_robots.maps.scan import Scan
from hcbf_robots.online.barrier_clock import BarrierClock
from hcbf_robots.online.follower import Follower
from hcbf_robots.online.odometry import Odometry
from hcbf_robots.online.robot import Robot, cap_of, known_of
from hcbf_robots.online.sample import Sample, frame_of, number, placed, sample_of
from hcbf_robots.walkers.walker_margins import (
    axle_of,
    braked,
    margins,
    stops,
    warn_of_lateness,
    warn_of_standing,
)
from hcbf_robots.walkers.walker_response import assumed

if TYPE_CHECKING:
    from hcbf_gym.certificates import Certificate
    from hcbf_robots.walkers.walker import Walker

HARDEST = 5.0
"""Of each component of U before the robot's own braking is known [m/s²], as in the paper."""

LATE = 1.1
"""Periods after the last sample from which on one is missing, and the command was zero."""
LEAP = 1.0
"""A stamp that is so far ahead may be wrong: the next one may go back behind it [s]."""
USUAL = 1.5
"""Of the greatest speed, up to which the filter's own α₁ is used [m/s]."""
UNKNOWN = np.full(3, np.nan)
"""A frame that is not given."""
LED_FOR = 0.5
"""Guidance looks at new barriers no sooner after it has looked at others [s]."""


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
        known = known_of(robot)
        response = known.response or assumed(known.command)
        if response.complaints:
            warn_caller(
                "velocity filter: rank 1 is not promised (covered = 0), as the robot does not "
                f"follow: {'; '.join(response.complaints)}",
                CoverageWarning,
            )
        if known.response:
            warn_of_lateness(known.command, known.response)
        self._max_age = finite_float("max_age", max_age, minimum=0.0)
        self._clock = BarrierClock()
        self._barriers: object = None
        self._looked_at: object = None  # the barriers at the last `set_barriers`
        self._looks = True  # whether guidance takes up new barriers
        self._unseen = True  # whether guidance has not looked at the barriers
        self._period = finite_float("period", period, minimum=0.0, maximum=0.2, exclusive=True)
        reach = known.reach if radius is None else radius
        reserved = margins(response, self._period, known.known_as)
        if certificate is not None:
            reserved = certificates.load(certificate).margins or reserved
        reserved = reserved._replace(body=finite_float("radius", reach, minimum=0.0))
        input_set = braked(Box.symmetric(HARDEST), response)
        axle = axle_of(known.command, response, Box.symmetric(HARDEST), known.command.forward)
        able, period = braking.weakest(input_set), self._period
        self._follower = Follower(known, axle, response.follows, able, period)
        self._hardest = input_set.radius if axle is None else axle.braking
        strays = input_set.radius if axle is None else axle.hardest_of_point
        self._odometry = Odometry(known, self._follower, strays, period)
        self.robot, self._response, self._reserved = known, response, reserved
        self.v_max = v_max
        self._plant = Plant(
            DoubleIntegrator(), _nothing, _nothing, input_set, period=self._period,
            uncertainty=reserved, axle=axle, max_age=self._max_age,
            braking=None if axle else stops(response, known.command.fastest, input_set),
            fastest=None if axle else known.command.fastest,
        )  # fmt: skip
        options = {"alpha1": _alpha_of(known.command.fastest)} | options
        self._settings = FilterSettings(
            program, "held", guidance, margin, None, on_alarm, False, options
        )
        self._input_set = input_set
        self._core = self._core_of(self._settings)
        self.barriers = barriers
        self._core.scenes.check(BarrierSet([self._listed(barriers)]))
        self.goal = goal
        self.reset()

    @property
    def barriers(self) -> Any:
        """The ranked conditions."""
        return self._barriers

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
        flag("look", look)
        self._clock.seen_at = None if seen_at is None else finite_float("seen_at", seen_at)
        listed = tuple(barriers) if isinstance(barriers, Sequence) else barriers
        self._unseen = self._unseen or (look and not _same(listed, self._looked_at))
        self._barriers, self._looked_at, self._looks = barriers, listed, look
        self._core.guide.follows = look
        self._warn_of_sight(listed)

    def check(self, barriers: Sequence[Element]) -> None:
        """Refuse barriers, before they are set, for which a step would only brake.

        Raises:
            InvalidInputError: if they are invalid, or a speed zone's limit is lower than what its
                row reserves and one input brings.
        """
        self._core.scenes.check_limits(BarrierSet([self._listed(barriers)]))

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
        found = None if goal is None else finite_array("goal", goal, (2,))
        guidance = self._settings.guidance
        if guidance is not None and found is None:
            raise InvalidInputError(
                f"goal: got None with guidance {guidance!r}, expected (x, y) where it leads [m]"
            )
        if found is not None:
            found.flags.writeable = False
        self._goal = found
        self._core.look_again()
        self._begun = False

    @property
    def lost(self) -> str:
        """Why guidance finds no path to the goal; "" where it finds one, or has not looked."""
        return self._core.lost

    @property
    def v_max(self) -> float | None:
        """Strict cap on the speed [m/s]; None for none but the greatest command."""
        return self._limit[0].v_max if self._limit else None

    @v_max.setter
    def v_max(self, v_max: float | None) -> None:
        if v_max is None:
            self._limit: tuple[SpeedLimit, ...] = ()
            self._follower.fastest = self._follower.begins_at = self.robot.command.fastest
            return
        kept = self._reserved.speed
        cap = cap_of(v_max, kept, self.robot)
        left, gained = float(braking.speed_left(cap, kept)), self._period * self._hardest
        if left <= gained:
            raise InvalidInputError(
                f"v_max: got {cap:g} m/s, which leaves {left:.3g} m/s after its margin, expected "
                f"above {gained:.3g} m/s, which an input reaches within one period: sample faster, "
                f"or leave v_max out and command no more: Command(forward={cap:g}, …)"
            )
        warn_of_standing(cap, self._reserved, self._response)
        self._limit = (SpeedLimit("speed limit", 1, cap),)
        follower = self._follower
        follower.begins_at, follower.fastest = left, math.sqrt(left**2 - gained**2)

    @property
    def fastest(self) -> float:
        """The greatest commanded speed [m/s]."""
        return self._follower.fastest

    @property
    def horizon(self) -> float:
        """How far from its centre a robot must see a region, at the speed `fastest` [m]."""
        kept, fastest = self._reserved, self.fastest + self._hardest * self._period
        away = self._core.config.alpha1.inverse(fastest) + fastest * self._period
        return away + kept.distance + kept.cap + kept.body

    def _warn_of_sight(self, barriers: object) -> None:
        """Warn of a scan that ends where the robot must see farther."""
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
        """Return the core; measurements are compared here, at their own times."""
        core = FilterCore(self._plant, self._input_set, settings)
        core.leave_monitor()
        core.guide.follows = self._looks
        return core

    def reset(self) -> None:
        """Forget the past: the robot is at rest anywhere, and time begins anew."""
        self._core.restart(np.ones(1, dtype=np.bool_))
        self._clock.forget()
        self._led_from = -math.inf  # when guidance looked at barriers last [s]
        self._time: float | None = None  # of the last sample, while none is missing [s]
        self._filtered: object = None  # the barriers of that step
        self._begun = self._is_framed = False
        self._follower.forget()
        self._odometry.forget()
        self._good_from = self._good_until = -math.inf
        self._last = self._leapt_from = math.nan  # presents [s]

    def go_on_from(self, other: "VelocityFilter") -> None:
        """Take the place and the state of another filter of the same robot.

        So a filter can be made beside a loop, and look at goal and barriers in a first step there.
        The other is not to be used on.
        """
        instance("other", other, VelocityFilter)
        self._follower.go_on_from(other._follower)
        self._odometry.go_on_from(other._odometry)
        self._good_from, self._good_until = other._good_from, other._good_until
        self._time, self._last, self._leapt_from = other._time, other._last, other._leapt_from
        self._is_framed = other._is_framed
        self._clock.go_on_from(other._clock)
        self._core.go_on_from(other._core)

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
        follower = self._follower
        given_as = floats("command", command, (len(follower.limits),)).dtype
        wanted = finite_array("command", command, (len(follower.limits),))
        given = sample_of(pose, twist, time)
        sample = given if now is None else self._odometry.newest(given, number(now))
        present = given.stamp if now is None else number(now)
        self._look_back(present)
        self._clock.look(present)
        self._core.scenes.scan_ages.clock_zero = self._clock.zero
        if self._time is not None and present - self._time > LATE * self._period:
            self._miss()
        age = 0.0 if now is None else present - sample.stamp
        self._is_framed = self._is_framed or frame is not None
        correction = frame_of(frame) if frame is not None or not self._is_framed else UNKNOWN
        is_new = sample.place is given.place
        estimate, heading, turning, is_valid = self._look(
            sample, correction, present, age, is_new=is_new
        )
        barriers = self._taken(self._scene(), estimate, present, is_valid=is_valid)
        if self._time is not None and present > self._time:
            estimate = estimate._replace(elapsed=present - self._time)
        velocity = estimate.x[2:]
        nominal = follower.nominal(wanted, heading, velocity)
        u, report = self._core.step(nominal, barriers, estimate, self._clock.since_seen)
        self._filtered = barriers
        if report["status"] == FilterStatus.BACKUP:
            self._time, out = None, follower.stop()
        else:
            self._time = present
            follower.follow(velocity, u, heading, present)
            out = follower.command(wanted, heading, turning)
        out = out.astype(given_as).astype(np.float64)  # what the robot gets
        self._odometry.note_command(out, present)
        self._good_from = present
        self._good_until = present + self._period if math.isfinite(present) else -math.inf
        report["valid_until"] = np.float64(self._good_until)
        return out.astype(given_as), report

    def _look(
        self, sample: Sample, correction: Array, present: float, age: float, *, is_new: bool
    ) -> tuple[Estimate, float, float, bool]:
        """Return the robot at present [s], its heading, its turning rate, and whether it is valid.

        A sample of an age [s] and its frame (3,) give them.
        """
        follower, odometry = self._follower, self._odometry
        motion = sample.motion
        place = placed(correction, sample.place)
        sound = bool(np.isfinite(place.sum() + motion.sum() + present + age))
        if sound and is_new:
            odometry.watch(sample)
        if sound:
            follower.turn(correction[2])
        stale = not clocks.is_accepted(age, self._max_age)
        if sound and not stale and age > 0.0:
            place, motion = odometry.propagated(place, motion, sample.stamp, present)
        body = follower.measured(place, motion)
        velocity = follower.now(body[2:], place[2], present) if sound else follower.velocity
        x = np.array([body[0], body[1], *velocity])
        lag = np.array([0.0, 0.0, *(body[2:] - velocity)])
        covariance = odometry.covariance(self._core.config.uncertainty.confidence)
        time, fault = self._clock.since(present), odometry.fault or None
        estimate = Estimate(x, time, covariance, x, lag, place[2], age=age, fault=fault)
        return estimate, float(place[2]), float(motion[2]), sound and not stale

    def _taken(
        self, barriers: object, estimate: Estimate, present: float, *, is_valid: bool
    ) -> object:
        """Let the core look at barriers where it must; None where no filter can begin with them."""
        begins = not self._begun and is_valid
        leads = self._unseen and self._clock.is_sound and self._core.guides
        if begins:
            self._core.cover(Coverage.OUTSIDE)
        elif leads and present - self._led_from >= LED_FOR:
            self._core.look_again()
        else:
            return barriers
        self._led_from, self._unseen = present, False
        try:
            self._core.begin(barriers, estimate, self._goal, None, self._clock.since_seen)
            self._begun = self._begun or begins
        except InvalidInputError as error:
            as_before = "" if begins else "; guidance leads as before"
            warn_caller(f"velocity filter: {error}{as_before}", SafetyWarning)
            return None if begins else barriers
        return barriers

    def _look_back(self, present: float) -> None:
        """Begin anew where the last present was far ahead, and time continues before it."""
        leapt = self._leapt_from < present <= self._last
        if math.isinf(self._leapt_from):
            leapt = self._last - present > LEAP
        if leapt:
            self._core.join(np.ones(1, dtype=np.bool_))
            self._odometry.compare_anew()
            self._follower.pause()
            self._begun, self._time = False, None
            self._clock.begin(present)
        if math.isfinite(present):
            last = -math.inf if math.isnan(self._last) else self._last  # the first may have leapt
            self._leapt_from = last if present - last > LEAP else math.nan
            self._last = present

    def command_at(self, now: float) -> Array:
        """Return the command now [s]: the last one while it is good, else zero.

        It serves loops that send commands more often than data come. Before the last sample's time,
        where a clock has gone back, it is zero, too.
        """
        good = self._good_from - ROUNDING <= number(now) <= self._good_until
        return self._odometry.command.copy() if good else np.zeros(len(self._follower.limits))

    def _miss(self) -> None:
        """Note that samples are missing: the robot's motion meanwhile is unknown."""
        last = None if self._time is None else self._clock.since(self._time)
        old = Estimate(np.zeros(4), last, heading=0.0, age=math.inf)
        self._core.step(np.zeros(2), self._filtered, old, self._clock.since_seen)
        self._follower.stop()
        self._time = None

    def _scene(self) -> object:
        """Return the user's barriers with the speed limit, or what the core refuses.

        That is None for barriers of no valid time.
        """
        if not self._clock.is_sound:
            return None
        try:
            return self._listed(self.barriers)
        except InvalidInputError:  # the core names it; an environment's set it would take
            return None if isinstance(self.barriers, BarrierSet) else self.barriers

    def _listed(self, barriers: object) -> tuple[Element, ...]:
        """Return barriers with the speed limit; refuse those that are no sequence."""
        if not is_list(barriers):
            raise InvalidInputError(
                f"barriers: got {shown(barriers)}, expected a sequence of Barriers"
            )
        return (*barriers, *self._limit)


def _alpha_of(fastest: float) -> LogClassK:
    """Return α₁ for a robot of a greatest speed [m/s]: the filter's own up to `USUAL`.

    With φ₁ as it is, α₁⁻¹ grows by the exponential of the speed, and with it how far the robot must
    see. The slope at 0 stays.
    """
    usual = LogClassK()
    grown = max(1.0, fastest / USUAL)
    return LogClassK(grown * usual.phi1, usual.phi2 / grown, usual.phi3)


def _same(one: object, other: object) -> bool:
    """Return whether two lists hold the same objects."""
    if not isinstance(one, Sequence) or not isinstance(other, Sequence):
        return False
    return len(one) == len(other) and all(map(operator.is_, one, other))


def _nothing(*_: object) -> tuple[()]:
    """Return nothing: a reader of the plant that this filter does not use."""
    return ()
