"""The filter for a loop of the user's own: a robot that takes velocities, without Gymnasium."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import certificates
from hcbf_gym.arrays import Array
from hcbf_gym.barriers import Barrier, SpeedLimit, braking
from hcbf_gym.barriers.set import BarrierSet
from hcbf_gym.barriers.speed_limit import check_leaves_speed
from hcbf_gym.errors import InvalidInputError, SafetyWarning, finite_array, finite_float
from hcbf_gym.filtering.belief import real_numbers
from hcbf_gym.filtering.planar_core import PlanarCore
from hcbf_gym.filtering.settings import FilterSettings
from hcbf_gym.models.constants import FARTHEST
from hcbf_gym.models.input_sets import Box
from hcbf_gym.models.plant import Coverage, Estimate, Plant, Reason
from hcbf_gym.models.reduced_order import DoubleIntegrator
from hcbf_gym.programs import FilterStatus
from hcbf_gym.robots.response_monitor import ResponseMonitor
from hcbf_gym.robots.walker import Walker
from hcbf_gym.robots.walker_adapter import Adapter
from hcbf_gym.robots.walker_margins import braked, margins, speed_cap
from hcbf_gym.robots.walker_parts import Command
from hcbf_gym.robots.walker_response import UNKNOWN, Response

HARDEST = 5.0
"""Of each component of U before the robot's own braking is known [m/s²], as in the paper."""


ROUNDING = 1e-9
"""By how much a present may seem to be before its past [s]."""
LATE = 1.1
"""Periods after the last sample from which on one is missing, and the robot was told zero."""
PAUSE = 1.5
"""Periods without one after which the model begins anew, unless the robot follows more slowly."""


@dataclass(frozen=True)
class Robot:
    """What the filter must know of a robot without a contract.

    Args:
        command: what it may be told.
        response: how it follows; None assumes a slow robot that sways.
        reach: radius of the circle around its centre that holds it [m].
        known_as: what certificates call it; "" for a robot of which there is none.
    """

    command: Command
    response: Response | None = None
    reach: float = 0.0
    known_as: str = ""


class VelocityFilter:
    """Filters every velocity command of a robot through one of the programs.

    In every period the user hands over what the robot shall do, where it is and how it moves, and
    tells the robot what comes back. What is old or not finite is not believed: the command is zero
    then, at once, until there are good data again.

    Args:
        robot: a contract's path or name, see `robots.Walker.load`; a `Walker`; or a `Robot`.
        barriers: the ranked conditions on the robot's position, in the frame of the pose; the
            attribute of this name may be set anew at any time.
        program: a name from `hcbf_gym.programs.names()` that is compiled.
        period: the longest regular time between two calls [s]; shorter ones do no harm. A command
            is good for that long.
        goal: (2,) where guidance leads [m]; None without guidance.
        guidance: as `wrappers.SafetyFilter` takes it.
        v_max: strict cap on the speed [m/s]; None takes the greatest that the robot may be told.
        radius: what the robot reaches beyond the point that follows its commands [m]; None takes
            the robot's reach, and ℓ besides for a differential drive.
        max_age: the greatest age of data that are believed [s].
        on_alarm: what an alarm leads to, "warn" or "brake": the robot does not do what it is told,
            or pose and twist do not fit (`docs/failing_closed.md`). It lasts until `reset`.
        **options: as `wrappers.SafetyFilter` takes them.

    Raises:
        InvalidInputError: if an option is unknown or out of range, the barriers are none, no speed
            is left, or one period at full input passes the speed limit.
        UnknownNameError: if a name is not known; the message lists the choices.

    Examples:
        >>> from hcbf_gym.barriers import Disc
        >>> door = VelocityFilter("cart", [Disc("pillar", 1, center=(2.0, 0.0), radius=0.5)])
        >>> command, report = door.step((0.5, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)
        >>> command.shape, report["status"]
        ((2,), np.int64(1))
    """

    def __init__(
        self,
        robot: str | Path | Walker | Robot,
        barriers: Sequence[Barrier],
        program: str = "lex-cbf-qp",
        period: float = 0.05,
        goal: ArrayLike | None = None,
        guidance: Any = None,
        v_max: float | None = None,
        radius: float | None = None,
        max_age: float = 0.1,
        on_alarm: str = "warn",
        **options: Any,
    ):
        known = _known(robot)
        self.barriers: Any = barriers
        self._period = finite_float("period", period, minimum=0.0, maximum=0.2, exclusive=True)
        self._max_age = finite_float("max_age", max_age, minimum=0.0)
        self._adapter = Adapter(known.command, known.response, "free")
        self._limits = known.command.limits
        reach = known.reach + self._adapter.look_ahead if radius is None else radius
        reserved = margins(known.response, self._period, known.known_as)
        reserved = reserved._replace(body=finite_float("radius", reach, minimum=0.0))
        self._cap = speed_cap(known.command, v_max)
        check_leaves_speed("v_max", self._cap, reserved.speed)
        self._limit = SpeedLimit("speed limit", 1, self._cap)
        input_set = braked(Box.symmetric(HARDEST), known.response)
        self._able = braking.weakest(input_set)
        plant = Plant(
            DoubleIntegrator(), _nothing, _nothing, input_set, period=self._period,
            uncertainty=reserved,
        )  # fmt: skip
        settings = FilterSettings(program, "held", guidance, None, None, on_alarm, False, options)
        self._core = PlanarCore(plant, input_set, settings)
        self._core.check_scene(BarrierSet([self._listed(barriers)]))
        self._follows = (known.response or UNKNOWN).follows
        self._monitor = ResponseMonitor(known.command, known.response)
        self._goal = None if goal is None else finite_array("goal", goal, (2,))
        if guidance is not None and self._goal is None:
            raise InvalidInputError(
                f"goal: got None with guidance {guidance!r}, expected (x, y) where it leads [m]"
            )
        self.reset()

    def reset(self) -> None:
        """Forget the past: the robot stands anywhere, and time begins anew."""
        self._core.restart(np.ones(1, dtype=np.bool_))
        self._velocity: Array = np.zeros(2)  # of the model, in the world [m/s]
        self._input: Array = np.zeros(2)
        self._time: float | None = None  # of the last sample, while none is missing [s]
        self._moved = -math.inf  # when the model's velocity was last known [s]
        self._begun = False
        self._monitor.forget()
        self._fault = Reason.NONE
        self._told: Array = np.zeros(len(self._limits))
        self._good_from = self._good_until = -math.inf

    def step(
        self,
        command: ArrayLike,
        pose: ArrayLike | None,
        twist: ArrayLike | None,
        time: float,
        now: float | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """Return what to tell the robot, and the report of it.

        Args:
            command: what it shall do, in its own axes: (v_x, v_y, ω), or (v, ω) of a differential
                drive [m/s, rad/s].
            pose: (x, y, θ) of its centre in the barriers' frame [m, rad]; None where there is none.
            twist: (v_x, v_y, ω) of its centre, in its own axes [m/s, rad/s]; None where there is
                none.
            time: at which pose and twist were measured [s].
            now: the present on the same clock, from which their age counts [s]; None is `time`.

        Returns:
            The command in the robot's axes, and a dict as ``info["safety_filter"]`` has it, with
            `valid_until` besides: the time from which on the command is zero unless there is
            another.

        Raises:
            InvalidInputError: if the command is not made of finite numbers; then nothing has
                happened.
        """
        wanted = finite_array("command", command, (len(self._limits),))
        place, motion = _numbers(pose), _numbers(twist)
        stamp = _number(time)
        age = 0.0 if now is None else _number(now) - stamp
        if self._time is not None and stamp - self._time > LATE * self._period:
            self._miss()
        sound = bool(np.isfinite(place.sum() + motion.sum() + stamp))
        body = self._follower(place, motion)
        velocity = self._now(stamp, body[2:]) if sound else self._velocity
        x = np.array([body[0], body[1], *velocity])
        lag = np.array([0.0, 0.0, *(body[2:] - velocity)])
        stale = not -ROUNDING <= age <= self._max_age
        point = np.array([body[0], body[1], place[2]])
        if sound and self._monitor.observe(point, body[2:], stamp, self._good_until):
            self._fault = Reason.RESPONSE
        estimate = Estimate(
            x,
            stamp,
            None,
            x,
            lag,
            age=math.inf if stale else max(0.0, age),
            fault=self._fault or None,
        )
        barriers = self._scene()
        if not self._begun and sound and not stale:
            self._core.cover(Coverage.OUTSIDE)
            try:
                self._core.begin(barriers, estimate, self._goal, None)
                self._begun = True
            except InvalidInputError as error:  # no filter can begin with these barriers
                warnings.warn(f"velocity filter: {error}", SafetyWarning, stacklevel=2)
                barriers = None
        if self._time is not None and stamp > self._time:
            estimate = estimate._replace(elapsed=stamp - self._time)
        asked = self._asked(wanted, place[2], velocity)
        u, report = self._core.step(asked, barriers, estimate)
        if report["status"] == FilterStatus.BACKUP:
            self._time, told = None, np.zeros(len(self._limits))
        else:
            self._time = self._moved = stamp
            self._velocity, self._input = velocity, u
            told = self._tell(wanted, place[2], motion[2])
        self._told = told
        self._tell_monitor(stamp + max(0.0, age))
        self._good_from = stamp
        self._good_until = stamp + self._period if math.isfinite(stamp) else -math.inf
        report["valid_until"] = np.float64(self._good_until)
        return told.copy(), report

    def _tell_monitor(self, now: float) -> None:
        """Note what the robot is told from now on [s], where the clocks say when that is."""
        if math.isfinite(now):
            self._monitor.tell(self._told, now)
            self._monitor.tell(np.zeros(len(self._limits)), now + self._period)

    def command_at(self, now: float) -> Array:
        """Return what the robot is to be told now [s]: the last command while it is good, or zero.

        For a loop that talks to the robot more often than data come. Before the last sample's time,
        where a clock has gone back, it is zero, too.
        """
        good = self._good_from - ROUNDING <= now <= self._good_until
        return self._told.copy() if good else np.zeros(len(self._limits))

    def _follower(self, place: Array, motion: Array) -> Array:
        """Return (4,) position and velocity in the world of the point that follows commands."""
        x, y, yaw = place
        cos, sin = math.cos(yaw), math.sin(yaw)
        ahead = self._adapter.look_ahead
        forward, aside = motion[0], motion[1] + motion[2] * ahead
        return np.array(
            [
                x + ahead * cos,
                y + ahead * sin,
                cos * forward - sin * aside,
                sin * forward + cos * aside,
            ]
        )

    def _now(self, stamp: float, measured: Array) -> Array:
        """Return the model's velocity now.

        It is what the last input has made of it. After a pause of more than τ + δ nothing that was
        told before is under way, and the model begins with the measured velocity.
        """
        passed = stamp - self._moved
        if passed > max(self._follows, PAUSE * self._period):
            return self._capped(measured)
        return self._velocity + min(max(passed, 0.0), self._period) * self._input

    def _capped(self, velocity: Array) -> Array:
        """Return a measured velocity, shortened to what the cap allows: the model begins there."""
        speed = float(np.hypot(*velocity))
        most = braking.speed_left(self._cap, self._core.uncertainty.speed)
        return velocity * min(1.0, float(most) / speed) if speed > 0.0 else velocity

    def _asked(self, wanted: Array, yaw: float, now: Array) -> Array:
        """Return u* (2,) that gives the model the wanted velocity, or as near as U comes."""
        wanted = np.clip(wanted, -FARTHEST, FARTHEST)
        told = wanted if len(wanted) == 3 else wanted * np.array([1.0, self._adapter.look_ahead])
        heading = yaw if math.isfinite(yaw) else 0.0
        cos, sin = math.cos(heading), math.sin(heading)
        velocity = np.array([cos * told[0] - sin * told[1], sin * told[0] + cos * told[1]])
        missing = (velocity - now) / self._period
        size = float(np.hypot(*missing))
        return missing * min(1.0, self._able / size) if size > 0.0 else missing

    def _tell(self, wanted: Array, yaw: float, rate: float) -> Array:
        """Return the command after the chosen input, in the robot's axes."""
        soon = self._velocity + self._period * self._input
        self._adapter.turn = float(wanted[-1])
        return np.array(self._adapter.command(soon[0], soon[1], yaw, rate))

    def _miss(self) -> None:
        """Note that samples are missing: what the robot did meanwhile is not known."""
        old = Estimate(np.zeros(4), self._time, age=math.inf)
        self._core.step(np.zeros(2), self._scene(), old)
        self._time = None

    def _scene(self) -> Any:
        """Return the user's barriers with the speed limit; what is no list goes to the core."""
        try:
            return self._listed(self.barriers)
        except InvalidInputError:
            return self.barriers

    def _listed(self, barriers: Any) -> tuple[Barrier, ...]:
        """Return barriers with the speed limit.

        Raises:
            InvalidInputError: if they are no sequence.
        """
        if not isinstance(barriers, Sequence) or isinstance(barriers, str):
            raise InvalidInputError(f"barriers: got {barriers!r}, expected a sequence of Barriers")
        return (*barriers, self._limit)


def _known(robot: Any) -> Robot:
    """Return what is known of a robot, however it is given.

    Raises:
        InvalidInputError: if it is no robot.
    """
    if isinstance(robot, Robot):
        return robot
    if isinstance(robot, str | Path):
        robot = Walker.load(robot)
    if not isinstance(robot, Walker):
        raise InvalidInputError(
            f"robot: got {robot!r}, expected a contract's path or name, a Walker or a Robot"
        )
    known_as = certificates.robot_of(robot.name, robot.files)
    return Robot(robot.command, robot.response, robot.body.reach or 0.0, known_as)


def _numbers(values: Any) -> Array:
    """Return (3,) numbers of a message; NaN where they are none, or beyond all that is possible."""
    given = None if values is None else real_numbers(values, (3,))
    if given is None or np.abs(given).max() > FARTHEST:
        return np.full(3, np.nan)
    return given


def _number(value: Any) -> float:
    """Return a number of a message; NaN where it is none."""
    given = real_numbers(value, ())
    return math.nan if given is None else float(given)


def _nothing(*_: Any) -> Any:
    """Stand for readers that this filter does not use: it hands everything over itself."""
    return ()
