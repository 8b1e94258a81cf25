"""What a robot was told, and what its response makes of it: the velocity v̂, and what nobody knows.

`response_monitor` has the law; here v̂ follows the commands, and v_b does so within the robot's
braking.
"""

import numpy as np

from hcbf_gym.arrays import Array, Pair, Records
from hcbf_gym.compilation import kernel

WINDOWS = 7
"""How many windows there are, each twice as long as the one before."""
HELD = 256
"""Commands that are remembered: the delay's worth of the fastest controller."""

NOTES = np.dtype(
    [
        ("told_at", "f8", HELD),  # [s]
        ("told", "f8", (HELD, 3)),  # what they lead to: gain × command, in the plane [m/s], turning
        ("ends", "i8", HELD),  # whether it is the end of a command that was not renewed
        ("count", "i8"),  # of all that were told
        ("acting", "i8"),  # the number of the one that acts
        ("velocity", "f8", 2),  # v̂ in the robot's axes [m/s]
        ("braked", "f8", 2),  # v_b in the robot's axes [m/s]
        ("place", "f8", 3),  # x, y [m] and heading [rad] at the last sample
        ("time", "f8"),  # of it [s]
        ("begun", "i8"),  # whether there is one
        ("missed", "f8", (WINDOWS, 2)),  # r [m]
        ("moved", "f8", WINDOWS),  # m [m]
        ("doubt", "f8", WINDOWS),  # d [m]
        ("apart", "f8", (WINDOWS, 2)),  # q [m]
        ("widest", "f8", WINDOWS),  # the greatest ‖q‖ of late [m]
        ("seen", "f8", WINDOWS),  # w [s]
        ("missing", "f8", (2, 2)),  # c [m²/s]
        ("asked", "f8", 2),  # E [m²/s]
        ("hidden", "f8", 2),  # d of it [m²/s]
        ("worst", "f8"),  # the greatest share of a bound at the last sample
    ]
)

LAW = np.dtype(
    [
        ("tau", "f8"),  # [s]
        ("delay", "f8"),  # δ [s]
        ("first", "f8"),  # W₀ [s]
        ("most", "f8"),  # K S [m/s]
        ("lasting", "f8"),  # D [m/s]
        ("share", "f8"),  # a
        ("braking", "f8"),  # how hard a stop brakes [m/s²]
        ("overshoot", "f8"),  # by how much the speed exceeds all commands [m/s]
        ("arc", "f8"),  # A; 0 of a robot that was measured
        ("forward", "f8"),  # the greatest speed that the robot may be told [m/s]
    ]
)


@kernel(error_model="numpy")
def tell(notes: Records, moves: tuple[float, float, float], time: float, ends: bool) -> None:
    """Note what a robot is told from a time on [s], or that this is when a command ends.

    Args:
        notes: (1,) `NOTES`, written to.
        moves: what it leads to: gain × command, in the plane [m/s] and turning [rad/s].
        time: from when on [s].
        ends: whether it is the end of a command that was not renewed.
    """
    note = notes[0]
    while note.count > 0 and note.told_at[(note.count - 1) % HELD] >= time - 1e-9:
        note.count -= 1  # what was to come after it is told no more
    note.acting = min(note.acting, note.count)
    at = note.count % HELD
    note.told_at[at], note.ends[at] = time, ends
    for k in range(3):
        note.told[at, k] = moves[k]
    note.count += 1


@kernel(error_model="numpy", inline="always")
def renew(note: np.record, law: np.record, acting: int, velocity: Array) -> None:
    """Let v_b be where it is farther from the command that begins to act.

    Where the one before was not renewed in time, the robot may have gone on by it, or have braked.
    """
    last, end = (acting - 1) % HELD, (acting - 2) % HELD
    if acting < 2 or note.ends[last] != 0 or note.ends[end] == 0:
        return
    speed = np.hypot(velocity[0], velocity[1])
    lost = law.braking * (note.told_at[last] - note.told_at[end])
    left = max(0.0, 1.0 - lost / max(speed, 1e-9))
    x, y = note.told[last, 0], note.told[last, 1]
    goes_on = np.hypot(x - velocity[0], y - velocity[1])
    if np.hypot(x - left * velocity[0], y - left * velocity[1]) > goes_on:
        velocity[0] *= left
        velocity[1] *= left


@kernel(error_model="numpy", inline="always")
def doubt_of(
    note: np.record, law: np.record, acting: int, span: float, went: Pair, velocity: Array
) -> float:
    """Let v_b follow what acts for a time, and return what is not known of the way meanwhile [m].

    Args:
        note: what was told.
        law: of the response.
        acting: how many commands act, or have acted.
        span: the time [s].
        went: ∫v̂ dt over it [m].
        velocity: v_b; written to.
    """
    x = y = 0.0
    if acting > 0:
        last, before = (acting - 1) % HELD, (acting - 2) % HELD
        x, y = note.told[last, 0], note.told[last, 1]
        if note.ends[last] != 0 and acting > 1:  # which it may still do
            return np.hypot(note.told[before, 0], note.told[before, 1]) * span
    tau = max(law.tau, 1e-6)
    behind = np.hypot(x - velocity[0], y - velocity[1])
    most = law.braking * tau  # what it is behind where it need not brake harder
    braking = min(span, max(0.0, behind - most) / law.braking)
    left = (behind - law.braking * braking) * np.exp(-(span - braking) / tau)
    late = (behind - 0.5 * law.braking * braking) * braking
    late += tau * (behind - law.braking * braking - left)
    to_x, to_y = (x - velocity[0]) / max(behind, 1e-9), (y - velocity[1]) / max(behind, 1e-9)
    velocity[0], velocity[1] = x - left * to_x, y - left * to_y
    off = np.hypot(went[0] - x * span + late * to_x, went[1] - y * span + late * to_y)
    return off + law.overshoot * braking


@kernel(error_model="numpy", inline="always")
def act(note: np.record, law: np.record, now: float) -> None:
    """Let the commands act that a robot follows by now [s]."""
    note.acting = max(note.acting, note.count - HELD)
    while note.acting < note.count and note.told_at[note.acting % HELD] + law.delay <= now + 1e-9:
        note.acting += 1
        renew(note, law, note.acting, note.braked)


@kernel(error_model="numpy", inline="always")
def begin(note: np.record, law: np.record, now: float, velocity: Pair) -> None:
    """Let v̂ and v_b begin with a velocity (2,) that was measured now, in the robot's axes."""
    act(note, law, now)
    for k in range(2):
        note.velocity[k] = note.braked[k] = velocity[k]


@kernel(error_model="numpy")
def at_once(note: np.record, start: float, end: float) -> Pair:
    """Return ∫c dt (2,), where a robot without τ and δ moves from a time to another [m]."""
    k = note.count
    least = max(0, note.count - HELD)
    while k > least and note.told_at[(k - 1) % HELD] > start + 1e-9:
        k -= 1
    ahead = aside = 0.0
    now = start
    while now < end:
        until = min(end, note.told_at[k % HELD]) if k < note.count else end
        if k > least:
            ahead += note.told[(k - 1) % HELD, 0] * (until - now)
            aside += note.told[(k - 1) % HELD, 1] * (until - now)
        now = until
        k += 1
    return ahead, aside


@kernel(error_model="numpy")
def follow(
    note: np.record, law: np.record, start: float, end: float
) -> tuple[float, float, float, float]:
    """Let v̂ follow the commands from a time to another.

    Returns:
        ∫v̂ (2), ∫‖v̂‖, and the way that is not known [m]: of commands that were not renewed, and of
        those that ask for more than the robot's braking.
    """
    tau = max(law.tau, 1e-6)
    ahead = aside = length = doubt = 0.0
    now = start
    while now < end:
        act(note, law, now)
        until = end
        if note.acting < note.count:
            until = min(end, note.told_at[note.acting % HELD] + law.delay)
        forward = sideways = 0.0
        if note.acting > 0:
            forward = note.told[(note.acting - 1) % HELD, 0]
            sideways = note.told[(note.acting - 1) % HELD, 1]
        span = until - now
        left = np.exp(-span / tau)
        x, y = note.velocity[0] - forward, note.velocity[1] - sideways
        went = (
            forward * span + x * tau * (1.0 - left),
            sideways * span + y * tau * (1.0 - left),
        )
        ahead += went[0]
        aside += went[1]
        length += np.hypot(went[0], went[1])
        doubt += doubt_of(note, law, note.acting, span, went, note.braked)
        note.velocity[0], note.velocity[1] = forward + x * left, sideways + y * left
        now = until
    return ahead, aside, length, doubt
