r"""Detects robot motion that the measured twist or the commands do not predict.

Each odometry sample is compared with the one before it, at the times of their measurement. Let T
be the time between both and Δp the measured displacement. The sums below fade over a window W.
This module sets the bounds. The core computes the sums (`motion_monitor.hpp`, `monitor.hpp`).

**RESPONSE: motion against commands.** The robot's response (`walker_response`) turns its commands
into an expected velocity v̂. With its mean over a sample, e = Δp/T − v̂ is the velocity error. The
core sums the position error r [m], the expected path length m [m] and the observed time w [s]:

.. math:: r ← (1 - T/W) r + T e, \quad m ← (1 - T/W) m + T ‖v̂‖, \quad w ← (1 - T/W) w + T.

W₀ is the sum of the response's time constant and delay, at least `SHORTEST_WINDOW`. The alarm is
raised if in any of the windows W = W₀, 2 W₀, 4 W₀ … 64 W₀

.. math:: ‖r‖ > D w + \max(0, B - D) \min(\sqrt{W_0 w}, 2 W_0) + a m + d.

B is the `residual_bound` for velocity errors over W₀. They average out over longer times, except
for the `long_term_drift` D. The `motion_tolerance` a is the share of m that may be missing or too
much. d [m] allows for noise of positions, for commands that were not renewed in time, and for
changes of speed that are harder than the robot's braking.

A gait's oscillation makes B large, so r alone would miss many faults. But the velocity error of
late, scaled or turned motion correlates with v̂, and that of an oscillation does not. So the core
also sums the correlation c of both, with J the quarter turn, and the power E of v̂:

.. math:: c ← (1 - T/W) c + T (e·v̂, e·J v̂), \qquad E ← (1 - T/W) E + T ‖v̂‖^2.

Samples at less than a quarter of the greatest speed add nothing. The alarm is also raised if both
over 1 s and over 4 s (at least 4 W₀ and 16 W₀)

.. math:: ‖c‖ > a E + 0.6 B \sqrt{W_0 E} + d',

where d' [m²/s] is about d times the commanded speed.

**An unmeasured robot** may follow faster than its response states. v̂ has the greatest lag (time
constant and delay) that the robot may have, and a robot without lag would move by q more. Every
robot between them has an r near the line from 0 to q. So the distance of r from this line takes
the place of ‖r‖, and the bound grows by `lag_tolerance` times the greatest recent ‖q‖.

**MOTION: motion against twist.** The twist predicts the displacement T (v + v')/2 from the measured
velocities v and v' of both samples. Over W = 0.5 s the core sums the position error r, the measured
and the predicted displacement, and 0.6 T ‖v' − v‖. The alarm is raised if at three samples in a row

.. math:: ‖r‖ > 0.01\,\mathrm{m} + 0.1 \max(‖measured‖, ‖predicted‖) + turns + d'',

where "turns" is the sum of 0.6 T ‖v' − v‖, and d'' [m] allows for noise and for missing samples.
"""

import math
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array, Records, record_type, words_of
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import Response, assumed

SHORTEST_WINDOW = 0.1  # a few samples of any loop [s]
SHORTEST_RESPONSE_TIME = 1e-3  # avoids a division by 0 for a robot without lag and delay [s]
OBSERVED_FACTOR = 1.45  # hours show greater residuals than the minutes of identification
MEASURED_TOLERANCE = 0.15  # `motion_tolerance` of a robot whose response was measured
UNMEASURED_TOLERANCE = 0.2  # `motion_tolerance` of any other robot
UNMEASURED_DRIFT = 0.08  # `long_term_drift` of an unmeasured robot, as a share of its speed
UNMEASURED_LAG_TOLERANCE = 0.4
"""`lag_tolerance` of an unmeasured robot. Commands that oscillate at up to 5 rad/s take r off the
line from 0 to q by no more than this share of ‖q‖. Faster ones cause hardly any motion."""
RESIDUALS_ADD_UP = _core.RESIDUALS_ADD_UP  # the 2 of 2 W₀ in the inequality for r
REGULAR_PERIODS = 1.5  # if two samples are farther apart, samples between them are missing


class Bounds(NamedTuple):
    """The bounds on the difference between motion and commands; the module has the inequalities.

    Attributes:
        residual_bound: B, the greatest mean velocity error over W₀ [m/s].
        long_term_drift: D, the velocity error that does not average out [m/s].
        motion_tolerance: a, the share of the motion that may be missing or too much.
        lag_tolerance: the share of ‖q‖ by which r may be off the line from 0 to q; 0 if the lag
            was measured, so that r is compared with 0.
    """

    residual_bound: float
    long_term_drift: float
    motion_tolerance: float
    lag_tolerance: float

    def scaled(self, factor: float) -> "Bounds":
        """Return these bounds, each multiplied by a factor."""
        return Bounds(*(factor * bound for bound in self))


class Propagated(NamedTuple):
    """A robot's predicted pose and twist.

    Attributes:
        pose: (3,) x, y of the centre [m] and the heading [rad].
        twist: (3,) of the centre, in the robot's axes [m/s, rad/s].
        position_error: bound on the error of the predicted position [m].
    """

    pose: Array
    twist: Array
    position_error: float


class MotionMonitor:
    """Compares a robot's motion with its commands, and with its twist.

    Args:
        command: the limits of the robot's commands.
        response: how the robot follows its commands. None, or a response with complaints, gives
            the wide bounds of an unmeasured robot.
        bound_factor: factor of all RESPONSE bounds, above 1 if the declared plant differs from the
            simulated one.
        period: the regular time between two samples, at most [s]; 0 means that positions are exact
            and that the twist is not compared.
        max_acceleration: of the point that follows the commands, over missing samples [m/s²].

    Attributes:
        is_measured: whether the response was measured, without complaints.

    Examples:
        >>> command = Command(forward=1.0, turn=1.0, sideways=1.0)
        >>> monitor = MotionMonitor(command, None)
        >>> for k in range(100):  # commanded 1 m/s, it is at rest
        ...     monitor.command(np.array([1.0, 0.0, 0.0]), 0.02 * k)
        ...     reason = monitor.observe(np.zeros(3), np.zeros(2), 0.02 * (k + 1))
        >>> reason.name
        'RESPONSE'
    """

    def __init__(
        self,
        command: Command,
        response: Response | None,
        bound_factor: float = 1.0,
        period: float = 0.0,
        max_acceleration: float = 0.0,
    ):
        self.is_measured = response is not None and not response.complaints
        expected = assumed(command) if response is None else response
        if self.is_measured:
            bounds = _measured_bounds(expected)
        else:
            bounds = _unmeasured_bounds(expected, command.fastest)
        self._command = command
        self._gains = np.array(expected.gains(len(command.limits)))
        self._law = _law_record(expected, bounds.scaled(bound_factor))
        self._law["forward"] = command.forward
        self._law["regular"] = REGULAR_PERIODS * period
        self._law["hardest"] = max_acceleration
        self._notes = np.zeros(1, dtype=record_type("motion_monitor.Notes"))

    def reset(self) -> None:
        """Forget all samples and commands, as after a reset of the robot."""
        self._notes[:] = 0

    def command(self, command: Array, time: float, until: float = math.inf) -> None:
        """Note a command that the robot receives.

        Args:
            command: (k,) in the robot's axes [m/s, rad/s].
            time: from which on it holds [s].
            until: its end [s]. From then on the command is zero, but the robot may continue to
                follow this one for a while.
        """
        expected = self._gains * command
        ahead, aside = self._command.in_plane(expected)
        notes = words_of(self._notes)
        _core.motion_note_command(notes, (ahead, aside, expected[-1]), time, False)
        if until < math.inf:
            _core.motion_note_command(notes, (0.0, 0.0, 0.0), until, True)

    def observe(self, pose: Array, velocity: Array, time: float) -> Reason:
        """Compare an odometry sample with its predictions, and return RESPONSE, MOTION or NONE.

        Args:
            pose: (3,) x, y of the point that follows the commands [m] and the heading [rad].
            velocity: (2,) of that point in the world [m/s].
            time: of the measurement [s]; a sample whose time does not increase is ignored.
        """
        return Reason(_core.motion_observe(*self._words, pose, velocity, time))

    def propagate(self, pose: Array, twist: Array, since: float, now: float) -> Propagated:
        """Return the present pose and twist that the commands since an earlier sample predict.

        Args:
            pose: (3,) x, y of the centre [m] and the heading [rad], at the time `since`.
            twist: (3,) of the centre at that time, in the robot's axes [m/s, rad/s].
            since: the time of both [s].
            now: the present [s].
        """
        pose, twist = pose.copy(), twist.copy()  # the core overwrites them
        look_ahead = self._command.look_ahead or 0.0
        error = _core.motion_propagate(*self._words, look_ahead, pose, twist, since, now)
        return Propagated(pose, twist, error)

    @property
    def _words(self) -> tuple[Array, Array]:
        """The sums (`Notes`) and the bounds (`Law`), as the core takes them."""
        return words_of(self._notes), words_of(self._law)


def _response_time(response: Response) -> float:
    """Return the time until the robot has followed most of a step of its command [s]."""
    return max(response.follows, SHORTEST_RESPONSE_TIME)


def _measured_bounds(response: Response) -> Bounds:
    """Return the bounds for a robot whose response was measured."""
    response_time = _response_time(response)
    drift = response.residual[1] if response.lasting is None else response.lasting
    return Bounds(
        residual_bound=OBSERVED_FACTOR * response.deviation / response_time,
        long_term_drift=min(response.deviation / response_time, drift),
        motion_tolerance=MEASURED_TOLERANCE,
        lag_tolerance=0.0,
    )


def _unmeasured_bounds(response: Response, max_speed: float) -> Bounds:
    """Return the bounds for a robot up to a speed [m/s] that follows at least as fast as assumed.

    The inequality for r counts `residual_bound` over up to 2 W₀, as residuals may add up for so
    long. The assumed deviation is their whole sum, so it is divided by twice the response time.
    """
    return Bounds(
        residual_bound=response.deviation / (RESIDUALS_ADD_UP * _response_time(response)),
        long_term_drift=UNMEASURED_DRIFT * max_speed,
        motion_tolerance=UNMEASURED_TOLERANCE,
        lag_tolerance=UNMEASURED_LAG_TOLERANCE,
    )


def _law_record(response: Response, bounds: Bounds) -> Records:
    """Return the core's record `motion_monitor.Law`, filled by a response and its bounds."""
    law = np.zeros(1, dtype=record_type("motion_monitor.Law"))
    law["tau"], law["delay"] = response.time_constant, response.delay
    law["braking"], law["overshoot"] = response.braking, response.overshoot
    law["first"] = max(_response_time(response), SHORTEST_WINDOW)
    law["most"] = bounds.residual_bound
    law["lasting"] = bounds.long_term_drift
    law["share"] = bounds.motion_tolerance
    law["arc"] = bounds.lag_tolerance
    return law
