"""Measured against predicted motion of a robot that follows commands.

MOTION compares positions with the measured twist, at the times of their measurement. RESPONSE
compares them with the velocity v̂ that the response (`walker_response`) makes of the commands, over
windows that double from W₀, the larger of τ + δ and `SHORTEST`. The response's residuals set the
bounds: S is the greatest mean residual over the time in which the robot follows, D the part of it
that remains over long times. "Failing closed" has the law, the core computes it
(`motion_monitor.hpp`, `monitor.hpp`).

A gait's oscillation hides many a fault in the missing motion. Motion that is late, scaled or turned
correlates with v̂, the oscillation does not: so correlations over longer windows are compared, too.

An unmeasured robot follows with any τ and δ up to those that the rows assume. v̂ has the greatest
of both, and a robot without either moves by q more: every robot between is near the line from 0 to
q, and its distance from that line is compared.
"""

import math

import numpy as np

from hcbf_gym import _core
from hcbf_gym._core import Reason
from hcbf_gym.arrays import Array, record_type, words_of
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import Response, assumed

SHORTEST = 0.1  # the shortest window [s]: a few samples of any loop
LASTING = 0.08  # D of an unmeasured robot, a share of its greatest speed
BEYOND = 1.45  # K: hours show greater residuals than the minutes of identification
ADDS_UP = _core.RESIDUALS_ADD_UP  # over how many W₀ residuals add up
SHARE, DOUBTED = 0.15, 0.2
"""a: share of the motion that may be missing or too much, and of an unmeasured robot."""
ARC = 0.4
"""A: how far from the line, as a share of its length, a robot is whose τ and δ are between. Of
commands that swing at up to 5 rad/s it is no more, of faster ones hardly anything shows."""
PAUSE = 1.5  # periods from one sample to the next, beyond which some are missing


class MotionMonitor:
    """Compares a robot's motion with its commands, and with its twist.

    Args:
        command: the limits of its commands.
        response: how it follows; None, or one with complaints, gives wide bounds.
        widened: by how much bounds are wider, where the plant is declared to be another one.
        period: the longest regular time between two samples [s]; 0: positions are exact, and the
            twist is not compared.
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
        follows = max(known.follows, 1e-3)
        most, share = BEYOND * known.deviation / follows, SHARE
        lasting = known.residual[1] if known.lasting is None else known.lasting
        lasting = min(known.deviation / follows, lasting)
        if not self.is_measured:
            most, share = known.deviation / (ADDS_UP * follows), DOUBTED
            lasting = LASTING * command.fastest
        law = np.zeros(1, dtype=record_type("motion_monitor.Law"))
        law["tau"], law["delay"] = known.time_constant, known.delay
        law["first"] = max(follows, SHORTEST)
        law["most"], law["lasting"] = widened * most, widened * lasting
        law["share"], law["forward"] = widened * share, command.forward
        law["braking"], law["overshoot"] = known.braking, known.overshoot
        law["arc"] = 0.0 if self.is_measured else widened * ARC
        law["regular"], law["hardest"] = PAUSE * period, hardest
        self._law = law
        self._notes = np.zeros(1, dtype=record_type("motion_monitor.Notes"))

    def reset(self) -> None:
        """Start anew: after a reset, or where nothing is known of the robot's motion."""
        self._notes[:] = 0

    def command(self, command: Array, time: float, until: float = math.inf) -> None:
        """Note the robot's command (k,), in its own axes [m/s, rad/s], from a time on [s].

        From the time `until` on it is zero, which the robot may not yet follow.
        """
        follows = self._gains * command
        ahead, aside = self._command.in_plane(follows)
        words = words_of(self._notes)
        _core.motion_note_command(words, (ahead, aside, follows[-1]), time, False)
        if until < math.inf:
            _core.motion_note_command(words, (0.0, 0.0, 0.0), until, True)

    def observe(self, pose: Array, velocity: Array, time: float) -> Reason:
        """Compare odometry with its predictions, and return RESPONSE, MOTION or NONE.

        Args:
            pose: (3,) x, y of the point that follows [m] and the heading [rad].
            velocity: (2,) of that point in the world [m/s].
            time: of both [s]; one that does not increase counts nothing.
        """
        return Reason(_core.motion_observe(*self._words, pose, velocity, time))

    def propagate(self, pose: Array, twist: Array, since: float, now: float) -> float:
        """Propagate a robot by its commands, and return what its position may be off [m].

        Args:
            pose: (3,) of the centre then [m, rad]; written to.
            twist: (3,) of the centre then, in its own axes [m/s, rad/s]; written to.
            since: the time of both [s].
            now: the present [s].
        """
        ahead = self._command.look_ahead or 0.0
        return _core.motion_propagate(*self._words, ahead, pose, twist, since, now)

    @property
    def _words(self) -> tuple[Array, Array]:
        """Notes and law as the core takes them."""
        return words_of(self._notes), words_of(self._law)
