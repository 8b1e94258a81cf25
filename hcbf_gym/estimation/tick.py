"""One tick of the estimator: sense, predict, take in the feet, and a fix when it arrives."""

import numpy as np

from hcbf_gym.arrays import Array, Records
from hcbf_gym.compilation import kernel
from hcbf_gym.estimation.kalman import AXIS, MODEL, D, P, S, V, correct, predict
from hcbf_gym.estimation.sensing import (
    ERRORS,
    SLOW,
    move_slow_errors,
    planar_acceleration,
    sense,
    start_slow_errors,
)
from hcbf_gym.locomotion.leg import LEGS, foot_kinematics
from hcbf_gym.locomotion.leg_odometry import trunk_velocity
from hcbf_gym.locomotion.rotation import rotation_matrix, yaw_of
from hcbf_gym.locomotion.state import StateViews, state_views

GATE = 3.5
"""A foot that disagrees with the estimate by more standard deviations slips or lifts."""

ROLLING = 0.01
"""Standard deviation of what a standing foot does between two ticks [m/s]."""

SLIPPING = 0.005
"""Standard deviation of what standing feet slip in the simulation itself, slowly [m/s]: some .6 mm
in a stance of .13 s."""

COLUMNS = 4
"""Of a state: its means along x and y, and their derivatives by an error of the heading."""

SETTINGS = np.dtype(
    (
        np.record,
        [
            ("model", MODEL),
            ("errors", ERRORS),
            ("legs", LEGS),
            ("foot_radius", "f8"),  # [m]
            ("settled", "i8"),  # ticks of contact before a foot counts
            ("period", "i8"),  # ticks between fixes
            ("delay", "i8"),  # ticks from a fix to its arrival
            ("start", "f8"),  # variance of the white noise of the first position [m²]
        ],
    )
)

MEMORY = np.dtype(
    (
        np.record,
        [
            ("ticks", "i8"),  # since the reset
            ("velocity", "f8", 3),  # true, a tick ago [m/s]
            ("touching", "i8", 4),  # ticks that each foot has been reported in contact
            ("slow", SLOW),
            ("yaw", "f8"),  # [rad]
        ],
    )
)

PAST = np.dtype(
    (
        np.record,
        [
            ("fix", "f8", COLUMNS),  # taken at this instant [m]
            ("acceleration", "f8", COLUMNS),  # that led to it [m/s²]
            ("odometry", "f8", COLUMNS),  # [m/s]
            ("var_odometry", "f8"),  # negative where no foot stood
            ("x", "f8", (AXIS, COLUMNS)),
            ("cov", "f8", (AXIS, AXIS)),
        ],
    )
)
"""An instant that a fix still to come may change: what was known then, and what came in."""


@kernel()
def instant(past: Records, ticks: int) -> np.record:
    """Return the entry of an instant, from the ring that `past` is."""
    return past[ticks % len(past)]


@kernel()
def start(
    settings: Records,
    memory: Records,
    past: Records,
    truth: Array,
    noises: Records,
    row: int,
    told: Array,
) -> None:
    """Begin an episode at rest, with a position averaged over fixes.

    Args:
        settings: (1,) `SETTINGS`.
        memory: (1,) `MEMORY`, set anew.
        past: (delay + 1,) `PAST`, set anew.
        truth: (41,) the vector of a `RobotState`.
        noises: (k,) `NOISE`.
        row: of them that this tick takes.
        told: (41,) filled in with what is known of the robot.
    """
    known = settings[0]
    now = memory[0]
    errors = settings[0].errors
    noise = noises[row]
    now.ticks = 0
    now.velocity[:] = truth[19:22]
    now.touching[:] = 0
    start_slow_errors(errors, now.slow, noise)
    sense(errors, now.slow, noise, truth, told)
    now.yaw = yaw_of(rotation_matrix(told[3:7]))
    first = past[0]
    first.x[:] = 0.0
    first.cov[:] = 0.0
    for axis in range(2):
        error = now.slow.drift[axis] + np.sqrt(known.start) * noise.fix[axis]
        first.x[P, axis] = truth[axis] + error
    for i in range(D, AXIS):
        first.cov[i, i] = known.model.variance[i]
    first.cov[P, P] = known.start + known.model.variance[D]
    first.cov[P, D] = first.cov[D, P] = -known.model.variance[D]
    tell(first.x, told)


@kernel()
def tick(
    settings: Records,
    memory: Records,
    past: Records,
    truth: Array,
    noises: Records,
    row: int,
    told: Array,
) -> None:
    """Move the estimate on by one tick; arguments as in `start`."""
    known = settings[0]
    now = memory[0]
    errors = settings[0].errors
    noise = noises[row]
    before = instant(past, now.ticks)
    now.ticks += 1
    entry = instant(past, now.ticks)
    move_slow_errors(errors, now.slow, noise)
    sense(errors, now.slow, noise, truth, told)
    state = state_views(told)
    R = rotation_matrix(told[3:7])
    now.yaw = yaw_of(R)

    put_turned(planar_acceleration(errors, noise, truth, now.velocity, R), entry.acceleration)
    entry.fix[:2] = truth[:2] + now.slow.drift + errors.fix * noise.fix
    entry.fix[2:] = 0.0
    now.velocity[:] = truth[19:22]
    for foot in range(4):
        now.touching[foot] = now.touching[foot] + 1 if state.foot_contact[foot] else 0

    _advance(known, before, entry)
    average_feet(known, now, state, R, entry)
    _take_odometry(entry)
    if now.ticks > known.delay and (now.ticks - known.delay) % known.period == 0:
        take_fix(known, past, now.ticks - known.delay, now.ticks)
    tell(entry.x, told)


@kernel()
def put_turned(measured: Array, columns: Array) -> None:
    """Write a measured vector (2,) into columns (4,), and how an error of the heading turns it."""
    columns[0], columns[1] = measured[0], measured[1]
    columns[2], columns[3] = -measured[1], measured[0]


@kernel()
def average_feet(
    known: np.record, now: np.record, state: StateViews, R: Array, entry: np.record
) -> None:
    """Note the mean over the feet that have settled and agree with the prediction in `entry`."""
    var_rate = known.errors.rate**2
    cov, x = entry.cov, entry.x
    v, slip = x[V, :2], x[S, :2]
    sideways = known.errors.rotation[2] ** 2 * (v**2).sum()
    uncertain = cov[V, V] + 2.0 * cov[V, S] + cov[S, S] + sideways
    total = np.zeros(2)
    variance = 0.0
    count = 0
    feet = foot_kinematics(known.legs, state.joint_position, state.joint_velocity)
    for leg in range(4):
        if now.touching[leg] < known.settled:
            continue
        foot = trunk_velocity(feet, known.foot_radius, leg, state, R)
        velocity = foot.velocity + now.slow.slip
        noise = var_rate * foot.gain + ROLLING**2
        gap = velocity - v - slip
        if (gap**2).sum() <= GATE**2 * (uncertain + noise):
            total += velocity
            variance += noise
            count += 1
    entry.var_odometry = -1.0
    if count:
        put_turned(total / count, entry.odometry)
        entry.var_odometry = variance / count**2


@kernel()
def take_fix(known: np.record, past: Records, taken: int, now: int) -> None:
    """Take in the fix of tick `taken`, and play again what came in since, up to tick `now`."""
    entry = instant(past, taken)
    correct(entry.x, entry.cov, P, D, entry.fix, known.model.fix)
    for k in range(taken + 1, now + 1):
        following = instant(past, k)
        _advance(known, entry, following)
        _take_odometry(following)
        entry = following


@kernel()
def _advance(known: np.record, before: np.record, entry: np.record) -> None:
    entry.x[:] = before.x
    entry.cov[:] = before.cov
    predict(known.model, entry.x, entry.cov, entry.acceleration, known.errors.accelerometer**2)


@kernel()
def _take_odometry(entry: np.record) -> None:
    if entry.var_odometry > 0.0:
        correct(entry.x, entry.cov, V, S, entry.odometry, entry.var_odometry)


@kernel()
def tell(x: Array, told: Array) -> None:
    """Write the estimated planar position and velocity into a state's vector (41,)."""
    told[0:2] = x[P, :2]
    told[19:21] = x[V, :2]
