"""The margins of a robot that takes velocities, derived from how it follows its commands.

Rows reserve a distance, a speed limit reserves a speed, and U shrinks to what the robot can brake.
`uncertainty` has the law; the walkers' environments and `VelocityFilter` both use it.
"""

import math

from hcbf_gym import certificates
from hcbf_gym.barriers import braking
from hcbf_gym.barriers.class_k import LogClassK
from hcbf_gym.barriers.speed_limit import leaves_speed
from hcbf_gym.errors import (
    CoverageWarning,
    InvalidInputError,
    SafetyWarning,
    finite_float,
    warn_caller,
)
from hcbf_gym.models.axle import Axle
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import CAUTIOUS, Uncertainty
from hcbf_robots.walkers.walker_parts import Command
from hcbf_robots.walkers.walker_response import Response

LEAST_DISTANCE = 0.02  # that rows reserve for any robot [m]
LEAST_SPEED = 0.05  # that a speed limit reserves for any robot [m/s]
OVERSHOOT_FACTOR = 1.1  # a minute of identification does not show the greatest overshoot of an hour
SETTLING_TIME = 1.0 / LogClassK().derivative(0.0) + 1.0 / CAUTIOUS
"""1/α₁'(0) + 1/α₂' of the filter's own α's [s]: with a lasting velocity error e, as in a long turn,
the robot settles nearer than its row requires by e times this time."""
FADING_FACTOR = 1.25  # a velocity error that fades lasts for so many times τ + δ + T
GREATEST_ERROR = 0.25  # that the tracking error may add to the distance of a row [m]
ERROR_SHARE = 0.3  # share of the velocity error that a speed limit reserves
LATE_PATH_FACTOR = 4.0  # how often the path beyond the margin is added to the stopping distance
LATEST_OF_POINT, LATEST_OF_AXLE = 0.4, 0.5
"""τ + δ from which on robots entered what they drove straight at [s]: such as move in every
direction by up to 3 cm at 0.3 m/s, differential drives by 1 cm at 0.5 m/s and 14 cm at 1.5 m/s."""


def uncertainty(response: Response, period: float) -> Uncertainty:
    """Return what rows and the speed limit must reserve for a robot.

    A body that is faster towards a region than its command stays so for ``τ + δ + T``. One that
    remains faster by e settles nearer: with ḣ = v − e and v̇ = −(α₁' + α₂') v − α₁'α₂' (h − m), at
    h = m − (1/α₁' + 1/α₂') e. The residual within τ + δ is reserved in any case. T is the period
    between two inputs [s].
    """
    follows = response.follows
    _, often, _ = response.residual
    return Uncertainty(
        distance=LEAST_DISTANCE + often * follows,
        per_velocity=max(SETTLING_TIME, FADING_FACTOR * (follows + period)),
        per_lead=1.0,
        cap=GREATEST_ERROR,
        speed=LEAST_SPEED + OVERSHOOT_FACTOR * response.overshoot,
        speed_per_velocity=ERROR_SHARE,
    )


def margins(response: Response, period: float, robot: str, more: float = 0.0) -> Uncertainty:
    """Return `uncertainty`, or the greater values that a certificate of the robot found necessary.

    `robot` is its identity, see `certificates.robot_of`. `more` is added to the distance [m] and to
    the speed [m/s].
    """
    law = uncertainty(response, period)
    law = law._replace(distance=law.distance + more, speed=law.speed + more)
    return certificates.at_least(law, robot)


def speed_cap(command: Command, v_max: float | None, scene: float | None) -> tuple[float, bool]:
    """Return the cap on the speed [m/s], and whether the robot's motors alone set it.

    The user's cap `v_max` [m/s] counts before the scene's [m/s]; None means that there is none.

    Raises:
        InvalidInputError: if the user's cap is more than the robot may be commanded.
    """
    most = command.forward
    if v_max is None:
        return (most, True) if scene is None or scene > most else (scene, False)
    cap = finite_float("v_max", v_max, minimum=0.0, exclusive=True)
    if cap > most:
        raise InvalidInputError(
            f"v_max: got {cap} m/s, expected at most {most}, the greatest forward speed that the "
            "robot may be commanded"
        )
    return cap, False


def speed_row(cap: float, reserved: float, is_own: bool) -> float:
    """Return v_max of the row of the speed limit [m/s].

    If the robot's own motors set the cap [m/s], the row must still permit the greatest command
    after it has reserved the speed m [m/s]. That needs ``v_max = m + √(m² + cap²)``.

    Raises:
        InvalidInputError: if the row leaves no speed.
    """
    if is_own:
        return reserved + math.hypot(reserved, cap)
    if not leaves_speed(cap, reserved):
        raise InvalidInputError(
            f"v_max: got {cap:g} m/s, expected above {2.0 * reserved:g} m/s: the row of the speed "
            f"limit reserves {reserved:g} m/s, so that no speed is left; leave v_max out where the "
            "robot's motors cap its speed, or let hcbf identify measure how it follows"
        )
    return cap


def warn_of_standing(cap: float, known: Uncertainty, response: Response) -> None:
    """Warn of a cap [m/s] that leaves no speed at the robot's median velocity error."""
    usual = known.speed + known.speed_per_velocity * response.residual[0]
    if not leaves_speed(cap, usual):
        warn_caller(
            f"v_max: {cap:g} m/s leave a robot that follows to {response.residual[0]:.2g} m/s "
            f"nothing, as the row of the speed limit reserves {usual:.3g} m/s then: it hardly "
            f"moves; expected above {2.0 * usual:.3g} m/s, no v_max where the robot's motors cap "
            "its speed, or hcbf identify, which measures how it follows",
            SafetyWarning,
        )


def warn_of_lateness(command: Command, response: Response) -> None:
    """Warn of a robot that follows so late that such robots entered regions of rank 1."""
    latest = LATEST_OF_POINT if command.look_ahead is None else LATEST_OF_AXLE
    if response.follows >= latest:
        warn_caller(
            f"response: the robot follows {response.follows:.3g} s late (τ + δ), and rank 1 is not "
            f"promised from {latest:g} s on (covered = 0): such robots entered by centimetres, "
            "VIOLATED shortly before; expected quicker motors or messages, or a greater margin",
            CoverageWarning,
        )


def braked(input_set: InputSet, response: Response) -> InputSet:
    """Return U, shrunk until its largest input is no harder than the robot brakes."""
    share = response.braking / input_set.radius
    return input_set if share >= 1.0 else input_set.scaled(share)


def stops(response: Response, speed: float, input_set: InputSet) -> float | None:
    """Return the deceleration with which a body that follows τ + δ later stops [m/s²].

    Before it slows down, a body of the speed v moves by v (τ + δ). Meanwhile the model brakes with
    a, and the margin grows by c a (τ + δ), c being `SETTLING_TIME`, but by no more than
    `GREATEST_ERROR`. The rest of the path, ``x = (τ + δ) v − min(GREATEST_ERROR, c a (τ + δ))``, is
    taken `LATE_PATH_FACTOR` times from the braking: ``v² / (2 a) + LATE_PATH_FACTOR x =
    v² / (2 stops)``. v is the greatest speed that is commanded [m/s]. The result is None where no
    path is left.
    """
    able, follows = (1.0 - braking.RESERVE) * braking.weakest(input_set), response.follows
    late_path = max(0.0, follows * speed - min(GREATEST_ERROR, SETTLING_TIME * able * follows))
    if late_path == 0.0:
        return None
    stops_with = 1.0 / (1.0 / able + 2.0 * LATE_PATH_FACTOR * late_path / speed**2)
    return stops_with / (1.0 - braking.RESERVE)  # the law of braking takes the reserve off again


def axle_of(command: Command, response: Response, input_set: InputSet, v_max: float) -> Axle | None:
    """Return the limits of a differential drive; None for a robot that moves in every direction.

    The axle's inputs are a rectangle that turns with the heading. It is inscribed in the largest
    ball within U, so that it never leaves U. `v_max` is the cap on the speed [m/s].
    """
    if command.look_ahead is None:
        return None
    able = min(response.braking, braking.weakest(input_set) / math.sqrt(2.0))
    return Axle(command.look_ahead, min(command.forward, v_max), command.turn, able)
