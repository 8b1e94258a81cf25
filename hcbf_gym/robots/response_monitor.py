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
quarter turn, the windows W those of `COMPARED`, and over the samples at which ‖v̂‖ is above `FAST`
of the greatest speed,

.. math::
    c ← (1 - T/W) c + T (e·v̂, e·Jv̂), \quad E ← (1 - T/W) E + T ‖v̂‖^2,

and the alarm is raised where in both windows ``‖c‖ > a E + k K S √(W₀ E) + d'``: c/E is the share
of v̂ that is missing, or too much, along it and across; d' is d times the speed that was told. A
window is judged once it has seen W₀/k of motion, up to where sway may correlate with all of it.
"""

import math

import numpy as np

from hcbf_gym.arrays import Array, Pair, Records
from hcbf_gym.compilation import kernel
from hcbf_gym.robots.told import (
    HELD,
    LAW,
    NOTES,
    WINDOWS,
    at_once,
    begin,
    doubt_of,
    follow,
    renew,
    tell,
)
from hcbf_gym.robots.walker_parts import Command
from hcbf_gym.robots.walker_response import Response, assumed

SHORTEST = 0.1
"""The shortest window [s]: a few samples of any loop."""
LASTING = 0.08
"""D of an unmeasured robot, a share of its greatest speed."""
BEYOND = 1.45
"""K: hours show more sway than the minutes of identification."""
SWAYS = 2.0
"""Over how many W₀ sway adds up."""
SHARE, DOUBTED = 0.15, 0.2
"""a: share of the motion that may be missing or too much, and of an unmeasured robot."""
ARC = 0.4
"""A: how far from the line, as a share of its length, a robot is whose τ and δ are between. Of
commands that swing at up to 5 rad/s it is no more, of faster ones hardly anything shows."""
NOISE = 2.0
"""Standard deviations of the position that are no motion."""
FAST = 0.25
"""Share of the greatest speed above which motion is compared with what was told: legs that are told
less may stand."""
COMPARED = ((4.0, 16.0), (1.0, 4.0))
"""Windows over which it is [s], at least so many W₀: a fault that lasts shows in both."""
APART = 0.6
"""k: sway that is no answer to commands hardly correlates with them."""
FILLED = 0.6
"""Share of the shortest window that must have been seen."""
PAUSE = 0.5
"""Time between two samples, forth or back, after which all starts anew [s]."""
LEAP = 0.2
"""What position may be off within one sample before it counts as put elsewhere [m]."""
FASTEST = 3.0
"""Of the greatest speed that it may be told, and faster than which it counts as such, too."""
CARRIED = 0.05
"""Over which a robot turns around the mean of its headings, where it is carried on [s]."""


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
        law = np.zeros(1, dtype=LAW)
        law["tau"], law["delay"] = known.time_constant, known.delay
        law["first"] = max(follows, SHORTEST)
        law["most"], law["lasting"] = widened * most, widened * lasting
        law["share"], law["forward"] = widened * share, command.forward
        law["braking"], law["overshoot"] = known.braking, known.overshoot
        law["arc"] = widened * ARC if doubted else 0.0
        self._law = law
        self.is_measured = not doubted
        self._notes = np.zeros(1, dtype=NOTES)

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
        moves = self._command.in_plane(follows)
        tell(self._notes, (moves[0], moves[1], follows[-1]), time, False)
        if until < math.inf:
            tell(self._notes, (0.0, 0.0, 0.0), until, True)

    def observe(self, pose: Array, velocity: Array, time: float, noise: float = 0.0) -> bool:
        """Compare odometry with what the robot was told, and return whether that alarms.

        Args:
            pose: (3,) x, y of the point that follows [m] and the heading [rad].
            velocity: (2,) of that point in the world [m/s], with which all begins.
            time: of both [s]; one that does not go on says nothing.
            noise: standard deviation of x and y [m].
        """
        return bool(_observe(self._notes, self._law, pose, velocity, time, NOISE * noise))

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
        return float(_carry(self._notes, self._law, ahead, pose, twist, since, now))

    @property
    def worst(self) -> float:
        """The greatest share of its bound that a window had at the last sample; 1 is an alarm."""
        return float(self._notes[0]["worst"])


@kernel(error_model="numpy")
def _observe(
    notes: Records, laws: Records, pose: Array, velocity: Array, time: float, noise: float
) -> bool:
    note, law = notes[0], laws[0]
    passed = time - note.time
    if note.begun and -PAUSE < passed <= 0.0:
        return False
    turn = pose[2] - note.place[2]
    turn -= 2.0 * np.pi * np.round(turn / (2.0 * np.pi))
    middle = note.place[2] + 0.5 * turn
    dx, dy = pose[0] - note.place[0], pose[1] - note.place[1]
    cos, sin = np.cos(middle), np.sin(middle)
    ahead, aside = cos * dx + sin * dy, cos * dy - sin * dx
    leap = np.hypot(ahead, aside) > LEAP + FASTEST * law.forward * passed
    known = note.begun == 1 and 0.0 < passed <= PAUSE and not leap
    note.place[0], note.place[1], note.place[2] = pose[0], pose[1], pose[2]
    began, note.time, note.begun = note.time, time, 1
    if not known:
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        vx, vy = velocity[0], velocity[1]
        begin(note, law, time, (cos * vx + sin * vy, cos * vy - sin * vx))
        note.missed[:, :], note.moved[:], note.seen[:] = 0.0, 0.0, 0.0
        note.missing[:, :], note.asked[:] = 0.0, 0.0
        note.doubt[:], note.hidden[:] = 2.0 * noise, 0.0  # of the place where r begins
        note.apart[:, :], note.widest[:] = 0.0, 0.0
        return False
    forward, sideways = note.velocity[0], note.velocity[1]
    went_ahead, went_aside, length, doubt = follow(note, law, began, time)
    speed = np.hypot(forward, sideways)
    for last in range(max(0, note.count - 2), note.count):  # the last command, and its end
        speed = max(speed, np.hypot(note.told[last % HELD, 0], note.told[last % HELD, 1]))
    apart, hidden = (0.0, 0.0), doubt
    if law.arc > 0.0:
        x, y = at_once(note, began, time)
        apart = x - went_ahead, y - went_aside
        hidden += np.hypot(apart[0], apart[1]) + law.lasting * passed
    off = ahead - went_ahead, aside - went_aside
    strays = _strays(note, law, off, apart, length, passed, doubt, noise)
    differs = _differs(note, law, off, (went_ahead, went_aside), passed, hidden * speed, noise)
    note.worst = max(strays, differs)
    return note.worst > 1.0


@kernel(error_model="numpy")
def _strays(
    note: np.record,
    law: np.record,
    off: Pair,
    apart: Pair,
    length: float,
    passed: float,
    doubt: float,
    noise: float,
) -> float:
    """Add a sample to r and q of every window, and return the greatest share of its bound."""
    worst = 0.0
    for i in range(WINDOWS):
        keep = max(0.0, 1.0 - passed / (law.first * 2.0**i))
        note.missed[i, 0] = keep * note.missed[i, 0] + off[0]
        note.missed[i, 1] = keep * note.missed[i, 1] + off[1]
        note.moved[i] = keep * note.moved[i] + length
        note.doubt[i] = keep * note.doubt[i] + doubt
        note.seen[i] = seen = keep * note.seen[i] + passed
        note.apart[i, 0] = keep * note.apart[i, 0] + apart[0]
        note.apart[i, 1] = keep * note.apart[i, 1] + apart[1]
        length_of_q = np.hypot(note.apart[i, 0], note.apart[i, 1])
        note.widest[i] = max(length_of_q, keep * note.widest[i])
        if seen < FILLED * law.first:
            continue
        bound = _bound(law, seen, note.moved[i]) + note.doubt[i] + noise
        r, q = note.missed[i], note.apart[i]
        near = 0.0
        if note.widest[i] > 0.0:
            near = min(
                1.0, max(0.0, (r[0] * q[0] + r[1] * q[1]) / max(q[0] ** 2 + q[1] ** 2, 1e-12))
            )
            bound += law.arc * note.widest[i]
        worst = max(worst, np.hypot(r[0] - near * q[0], r[1] - near * q[1]) / bound)
    return worst


@kernel(error_model="numpy", inline="always")
def _bound(law: np.record, seen: float, moved: float) -> float:
    """Return what a robot's motion may be off over a time [m].

    Args:
        law: of its response.
        seen: the time [s].
        moved: the length of its way meanwhile [m].
    """
    swaying = min(np.sqrt(law.first * seen), SWAYS * law.first)
    return law.lasting * seen + max(0.0, law.most - law.lasting) * swaying + law.share * moved


@kernel(error_model="numpy")
def _differs(
    note: np.record,
    law: np.record,
    off: Pair,
    went: Pair,
    passed: float,
    hidden: float,
    noise: float,
) -> float:
    """Add a sample to c of both windows, and return the lesser share of the bound."""
    least = FAST * law.forward
    told = np.hypot(went[0], went[1]) > least * passed
    along, across = off[0] * went[0] + off[1] * went[1], off[1] * went[0] - off[0] * went[1]
    worst = np.inf
    for i, (seconds, times) in enumerate(COMPARED):
        keep = max(0.0, 1.0 - passed / max(seconds, times * law.first))
        note.missing[i, 0], note.missing[i, 1] = (
            keep * note.missing[i, 0],
            keep * note.missing[i, 1],
        )
        note.asked[i], note.hidden[i] = keep * note.asked[i], keep * note.hidden[i] + hidden
        if told:
            note.missing[i, 0] += along / passed
            note.missing[i, 1] += across / passed
            note.asked[i] += (went[0] ** 2 + went[1] ** 2) / passed
        if note.asked[i] < least**2 * law.first / APART:
            return 0.0  # the shorter window begins where the longer one has seen enough
        bound = law.share * note.asked[i] + APART * law.most * np.sqrt(law.first * note.asked[i])
        off_by = np.hypot(note.missing[i, 0], note.missing[i, 1])
        worst = min(worst, off_by / (bound + note.hidden[i] + noise * law.forward))
    return worst


@kernel(error_model="numpy")
def _carry(
    notes: Records, laws: Records, ahead: float, pose: Array, twist: Array, since: float, now: float
) -> float:
    note, law = notes[0], laws[0]
    tau, acting = max(law.tau, 1e-6), note.count
    while acting > max(0, note.count - HELD) and (
        note.told_at[(acting - 1) % HELD] + law.delay > since + 1e-9
    ):
        acting -= 1
    time, told, moved = since, np.zeros(3), np.zeros(3)
    braked = np.array([twist[0], twist[1] + ahead * twist[2]])
    length = doubt = 0.0
    while time < now:
        while acting < note.count and note.told_at[acting % HELD] + law.delay <= time + 1e-9:
            acting += 1
            renew(note, law, acting, braked)
        until = min(now, time + CARRIED)
        if acting < note.count:
            until = min(until, note.told_at[acting % HELD] + law.delay)
        if acting > 0:
            told[:] = note.told[(acting - 1) % HELD]
            told[1] -= ahead * told[2]  # of the centre
        span = until - time
        left = np.exp(-span / tau)
        for k in range(3):
            off = twist[k] - told[k]
            moved[k], twist[k] = told[k] * span + off * tau * (1.0 - left), told[k] + off * left
        cos, sin = np.cos(pose[2] + 0.5 * moved[2]), np.sin(pose[2] + 0.5 * moved[2])
        pose[0] += cos * moved[0] - sin * moved[1]
        pose[1] += sin * moved[0] + cos * moved[1]
        pose[2] += moved[2]
        went = moved[0], moved[1] + ahead * moved[2]
        length += np.hypot(went[0], went[1])
        doubt += doubt_of(note, law, acting, span, went, braked)
        time = until
    return _bound(law, now - since, length) + doubt
