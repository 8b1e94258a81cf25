"""Compares the measured motion of a robot with its twist and with its commands.

The alarm MOTION compares positions with the measured twist, at the times of their measurement. The
alarm RESPONSE compares them with the velocity v̂ that the response (`walker_response`) predicts from
the commands, over windows that double from W₀, the larger of τ + δ and `SHORTEST_WINDOW`. The
response's residuals set the bounds: S is the greatest mean residual over τ + δ, and D the part that
remains over long times. "Failing closed" has the law, which the core computes
(`motion_monitor.hpp`, `monitor.hpp`).

A gait's oscillation hides many a fault in the missing motion. Motion that is late, scaled or turned
correlates with v̂, the oscillation does not. So correlations over longer windows count, too.

An unmeasured robot may follow with any τ and δ up to those that the rows assume. v̂ is computed with
the greatest of both. A robot without lag and delay moves by q more than v̂. Every robot between is
near the line from 0 to q, so its distance from that line is compared.
"""

import math

import numpy as np

from hcbf_gym import _core
from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array, Records, record_type, words_of
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import Response, assumed

SHORTEST_WINDOW = 0.1  # a few samples of any loop [s]
OBSERVED_FACTOR = 1.45  # K: hours show greater residuals than the minutes of identification
RESIDUALS_ADD_UP = _core.RESIDUALS_ADD_UP  # for so many W₀ the residuals of an unmeasured robot add
MEASURED_SHARE, UNMEASURED_SHARE = 0.15, 0.2
"""a: the share of the motion that may be missing or too much."""
UNMEASURED_LASTING = 0.08  # D as a share of the greatest speed
UNMEASURED_ARC = 0.4
"""A: the share of ‖q‖ by which τ and δ between 0 and the greatest cause a distance from the line.
Commands that oscillate at up to 5 rad/s cause no more, faster ones hardly any motion."""
REGULAR_PERIODS = 1.5  # between two samples; after a longer time some are missing


class MotionMonitor:
    """Compares a robot's motion with its commands, and with its twist.

    Args:
        command: the limits of its commands.
        response: how it follows; None, or one with complaints, gives wide bounds.
        widened: factor of the bounds, above 1 where the declared plant is another one.
        period: the longest regular time between two samples [s]; 0 means that positions are exact,
            and the twist is not compared.
        hardest: the greatest acceleration of the point that follows [m/s²].

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
        widened: float = 1.0,
        period: float = 0.0,
        hardest: float = 0.0,
    ):
        known = assumed(command) if response is None else response
        self.is_measured = response is not None and not known.complaints
        self._gains = np.array(known.gains(len(command.limits)))
        self._command = command
        self._law = _law(command, known, self.is_measured, widened)
        self._law["regular"], self._law["hardest"] = REGULAR_PERIODS * period, hardest
        self._notes = np.zeros(1, dtype=record_type("motion_monitor.Notes"))

    def reset(self) -> None:
        """Forget all samples and commands, as after a reset of the robot."""
        self._notes[:] = 0

    def command(self, command: Array, time: float, until: float = math.inf) -> None:
        """Note a command (k,) of the robot, in its own axes [m/s, rad/s], from a time on [s].

        From the time `until` on the command is zero, which the robot may not yet follow.
        """
        expected = self._gains * command
        ahead, aside = self._command.in_plane(expected)
        notes = words_of(self._notes)
        _core.motion_note_command(notes, (ahead, aside, expected[-1]), time, False)
        if until < math.inf:
            _core.motion_note_command(notes, (0.0, 0.0, 0.0), until, True)

    def observe(self, pose: Array, velocity: Array, time: float) -> Reason:
        """Compare odometry with its predictions, and return RESPONSE, MOTION or NONE.

        Args:
            pose: (3,) x, y of the point that follows [m] and the heading [rad].
            velocity: (2,) of that point in the world [m/s].
            time: of both [s]; a sample whose time does not increase is ignored.
        """
        return Reason(_core.motion_observe(*self._words, pose, velocity, time))

    def propagate(self, pose: Array, twist: Array, since: float, now: float) -> float:
        """Propagate a robot by its commands, and return a bound on its position's error [m].

        Args:
            pose: (3,) of the centre at the time `since` [m, rad]; overwritten with the present one.
            twist: (3,) of the centre then, in its own axes [m/s, rad/s]; overwritten, too.
            since: the time of both [s].
            now: the present [s].
        """
        look_ahead = self._command.look_ahead or 0.0
        return _core.motion_propagate(*self._words, look_ahead, pose, twist, since, now)

    @property
    def _words(self) -> tuple[Array, Array]:
        """Notes and law, as the core takes them."""
        return words_of(self._notes), words_of(self._law)


def _law(command: Command, known: Response, is_measured: bool, widened: float) -> Records:
    """Return the core's record of the bounds, but for the regular period and the acceleration."""
    follows = max(known.follows, 1e-3)
    if is_measured:
        lasting = known.residual[1] if known.lasting is None else known.lasting
        lasting = min(known.deviation / follows, lasting)
        most, share, arc = OBSERVED_FACTOR * known.deviation / follows, MEASURED_SHARE, 0.0
    else:
        lasting = UNMEASURED_LASTING * command.fastest
        most = known.deviation / (RESIDUALS_ADD_UP * follows)
        share, arc = UNMEASURED_SHARE, UNMEASURED_ARC
    law = np.zeros(1, dtype=record_type("motion_monitor.Law"))
    law["tau"], law["delay"] = known.time_constant, known.delay
    law["first"] = max(follows, SHORTEST_WINDOW)
    law["most"], law["lasting"] = widened * most, widened * lasting
    law["share"], law["arc"] = widened * share, widened * arc
    law["forward"] = command.forward
    law["braking"], law["overshoot"] = known.braking, known.overshoot
    return law
