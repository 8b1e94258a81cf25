r"""Does a robot do what it is told? Its measured response says where it should have moved.

In the robot's own axes the response (`walker_response`) turns commands into a velocity v̂. Over
every sample of length T, with Δp the motion of the point that follows, in the axes of the mean
heading, and for windows W that double from W₀, the larger of τ + δ and `SHORTEST`,

.. math::
    r ← (1 - T/W) r + Δp - ∫v̂ \, dt, \quad m ← (1 - T/W) m + ∫‖v̂‖ dt, \quad
    w ← (1 - T/W) w + T.

The alarm is raised where in any window

.. math:: ‖r‖ > D w + (K S - D) \min(\sqrt{W_0 w}, 2 W_0) + a\, m + d

with S = sway/(τ + δ), the greatest mean residual over the time in which the robot follows, and D
what of it remains over long times (sway about it averages out): the response's residuals set both.
d is what nobody knows: what a command that was not renewed in time still did; ``‖∫(v̂ - v_b) dt‖``,
with v_b the velocity of a robot that follows as v̂ says, but changes it no harder than it brakes,
and its overshoot meanwhile.

An unmeasured robot follows with any τ and δ up to those that the rows assume. v̂ has the greatest
of both, and with c the commands, those of a robot without either lead to

.. math:: q ← (1 - T/W) q + ∫(c - v̂) \, dt.

Every robot between the two is near the line from 0 to q: instead of ``‖r‖`` its distance from that
line is compared, and the bound grows by A times the greatest ``‖q‖`` in the window.

A gait sways more than many a fault shows in r. What follows late, by another share or in another
direction correlates with v̂, which sway does not. With e the mean residual of a sample, J the
quarter turn, windows W of at least 4 s and 16 W₀, and 1 s and 4 W₀, and over the samples at which
‖v̂‖ is above a quarter of the greatest speed,

.. math::
    c ← (1 - T/W) c + T (e·v̂, e·Jv̂), \quad E ← (1 - T/W) E + T ‖v̂‖^2,

and the alarm is raised where in both windows ``‖c‖ > a E + k K S √(W₀ E) + d'``: c/E is the share
of v̂ that is missing, or too much, along it and across; d' is d times the speed that was told. A
window is judged once it has seen W₀/k of motion, up to where sway may correlate with all of it.
"""

import math

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, record_type, words_of
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import Response, assumed

SHORTEST = 0.1
"""The shortest window [s]: a few samples of any loop."""
LASTING = 0.08
"""D of an unmeasured robot, a share of its greatest speed."""
BEYOND = 1.45
"""K: hours show more sway than the minutes of identification."""
SWAYS = _core.RESPONSE_SWAYS
"""Over how many W₀ sway adds up."""
SHARE, DOUBTED = 0.15, 0.2
"""a: share of the motion that may be missing or too much, and of an unmeasured robot."""
ARC = 0.4
"""A: how far from the line, as a share of its length, a robot is whose τ and δ are between. Of
commands that swing at up to 5 rad/s it is no more, of faster ones hardly anything shows."""
NOISE = 2.0
"""Standard deviations of the position that are no motion."""


class ResponseMonitor:
    """Compares what a robot was told with what it did.

    Args:
        command: what the robot may be told.
        response: how it follows; None, or one with complaints, gives wide bounds.
        widened: by how much bounds are wider, where the plant is declared to be another one.

    Attributes:
        is_measured: whether the response is one that was measured, without complaints.

    Examples:
        >>> command = Command(forward=1.0, turn=1.0, sideways=1.0)
        >>> monitor = ResponseMonitor(command, None)
        >>> for k in range(100):  # told 1 m/s, it stands
        ...     monitor.tell(np.array([1.0, 0.0, 0.0]), 0.02 * k)
        ...     alarmed = monitor.observe(np.zeros(3), np.zeros(2), 0.02 * (k + 1))
        >>> alarmed
        True
    """

    def __init__(self, command: Command, response: Response | None, widened: float = 1.0):
        known = assumed(command) if response is None else response
        doubted = response is None or bool(known.complaints)
        self._gains = np.array(known.gains(len(command.limits)))
        self._command = command
        follows = max(known.follows, 1e-3)
        most = BEYOND * known.sway / follows
        lasting = known.residual[1] if known.lasting is None else known.lasting
        lasting = min(known.sway / follows, lasting)
        share = DOUBTED if doubted else SHARE
        if doubted:
            most, lasting = known.sway / (SWAYS * follows), LASTING * command.fastest
        law = np.zeros(1, dtype=record_type("command_history.Law"))
        law["tau"], law["delay"] = known.time_constant, known.delay
        law["first"] = max(follows, SHORTEST)
        law["most"], law["lasting"] = widened * most, widened * lasting
        law["share"], law["forward"] = widened * share, command.forward
        law["braking"], law["overshoot"] = known.braking, known.overshoot
        law["arc"] = widened * ARC if doubted else 0.0
        self._law = law
        self.is_measured = not doubted
        self._notes = np.zeros(1, dtype=record_type("command_history.Notes"))

    def forget(self) -> None:
        """Start anew: after a reset, or where nothing is known of what the robot did."""
        self._notes[:] = 0

    def tell(self, command: Array, time: float, until: float = math.inf) -> None:
        """Note what the robot is told (k,), in its own axes [m/s, rad/s], from a time on [s].

        Args:
            command: of it.
            time: from when on [s].
            until: until when [s]; from then on it is told zero, and may not yet do that.
        """
        follows = self._gains * command
        ahead, aside = self._command.in_plane(follows)
        words = words_of(self._notes)
        _core.response_tell(words, (ahead, aside, follows[-1]), time, False)
        if until < math.inf:
            _core.response_tell(words, (0.0, 0.0, 0.0), until, True)

    def observe(self, pose: Array, velocity: Array, time: float, noise: float = 0.0) -> bool:
        """Compare odometry with what the robot was told, and return whether that alarms.

        Args:
            pose: (3,) x, y of the point that follows [m] and the heading [rad].
            velocity: (2,) of that point in the world [m/s], with which all begins.
            time: of both [s]; one that does not go on says nothing.
            noise: standard deviation of x and y [m].
        """
        return _core.response_observe(*self._words, pose, velocity, time, NOISE * noise)

    def carry(self, pose: Array, twist: Array, since: float, now: float) -> float:
        """Write where what it was told has brought a robot, and return what that may be off [m].

        It is what the alarm lets pass of the motion since.

        Args:
            pose: (3,) of the centre then [m, rad]; written to.
            twist: (3,) of the centre then, in its own axes [m/s, rad/s]; written to.
            since: the time of both [s].
            now: the present [s].
        """
        ahead = self._command.look_ahead or 0.0
        return _core.response_carry(*self._words, ahead, pose, twist, since, now)

    @property
    def _words(self) -> tuple[Array, Array]:
        """Notes and law as the core takes them."""
        return words_of(self._notes), words_of(self._law)

    @property
    def worst(self) -> float:
        """The greatest share of its bound that a window had at the last sample; 1 is an alarm."""
        return float(self._notes[0]["worst"])
