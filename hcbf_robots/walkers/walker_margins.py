"""What rows must reserve for a robot that takes velocities: the one law of its margins."""

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

LEAST_DISTANCE = 0.02  # what rows reserve for any robot [m]
LEAST_SPEED = 0.05  # what a speed limit reserves for any robot [m/s]
BEYOND = 1.1
"""Of the overshoot that a speed limit reserves: a minute does not show the worst of an hour."""
SETTLES = 1.0 / LogClassK().derivative(0.0) + 1.0 / CAUTIOUS
"""1/α₁'(0) + 1/α₂' of the filter's own α's [s]: by so much times a velocity error that stays, as in
a long turn, the robot settles nearer than its row requires."""
FARTHER = 1.25  # of τ + δ + T that the body continues with a velocity error
MOST = 0.25  # what the tracking error may add to a row [m]
SOONER = 4.0  # how often a late body's path beyond its margin is added to its stopping distance
LATEST_OF_POINT, LATEST_OF_AXLE = 0.4, 0.5
"""τ + δ from which on robots have entered what they drove straight at [s], such as move in every
direction by up to 3 cm at .3 m/s, differential drives by 1 cm at .5 m/s and 14 cm at 1.5 m/s."""
OVERSHOOT = 0.3  # share of the velocity error that a speed limit reserves


def uncertainty(response: Response, period: float) -> Uncertainty:
    """Return what rows must reserve for a robot, from how it follows.

    A body that is faster towards a region than its command continues for ``τ + δ + T``. One that
    stays faster by e settles nearer: with ḣ = v − e on the row v̇ = −(α₁' + α₂') v − α₁'α₂' (h − m),
    at h = m − (1/α₁' + 1/α₂') e. Its residual while it follows is reserved in any case. T is the
    period between two inputs [s].
    """
    follows = response.follows
    _, often, _ = response.residual
    return Uncertainty(
        distance=LEAST_DISTANCE + often * follows,
        per_velocity=max(SETTLES, FARTHER * (follows + period)),
        per_lead=1.0,
        cap=MOST,
        speed=LEAST_SPEED + BEYOND * response.overshoot,
        speed_per_velocity=OVERSHOOT,
    )


def margins(response: Response, period: float, robot: str, more: float = 0.0) -> Uncertainty:
    """Return `uncertainty`, and no less than a certificate of the robot found that it needs.

    Args:
        response: of the robot.
        period: T [s].
        robot: its identity, see `certificates.robot_of`.
        more: added to what rows [m] and the speed limit [m/s] reserve.
    """
    law = uncertainty(response, period)
    law = law._replace(distance=law.distance + more, speed=law.speed + more)
    return certificates.at_least(law, robot)


def speed_cap(command: Command, v_max: float | None, scene: float | None) -> tuple[float, bool]:
    """Return the cap on the speed [m/s], and whether nothing but the robot's motors sets it.

    Raises:
        InvalidInputError: if the user's `v_max` is more than the robot may be commanded.
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

    Where the robot's own motors cap its speed, the row counts by what they exceed the greatest
    command, ``v_max = m + √(m² + cap²)``, so that it leaves the model that command. m is what the
    row reserves [m/s].

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
    """Warn of a cap [m/s] that leaves nothing at the error at which a robot usually follows."""
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
    """Warn of a robot that follows later than any that stayed outside."""
    latest = LATEST_OF_POINT if command.look_ahead is None else LATEST_OF_AXLE
    if response.follows >= latest:
        warn_caller(
            f"response: the robot follows {response.follows:.3g} s late (τ + δ), and rank 1 is not "
            f"promised from {latest:g} s on (covered = 0): such robots entered by centimetres, "
            "VIOLATED shortly before; expected quicker motors or messages, or a greater margin",
            CoverageWarning,
        )


def braked(input_set: InputSet, response: Response) -> InputSet:
    """Return U, shrunk until the robot brakes as hard: no input is larger than that."""
    share = response.braking / input_set.radius
    return input_set if share >= 1.0 else input_set.scaled(share)


def stops(response: Response, speed: float, input_set: InputSet) -> float | None:
    """Return the deceleration with which a body stops that follows τ + δ later [m/s²].

    It is None where its margin has room for its path meanwhile.

    Until a body of the speed v slows down it moves by v (τ + δ). Its margin grows by c a (τ + δ),
    and by `cap` at most, as the model brakes with a: no sooner than the lag itself, when U has no
    more. So the rest of its path, ``x = (τ + δ) v − min(cap, c a (τ + δ))``, is taken from the
    braking `SOONER` times: ``v² / (2 a) + SOONER x = v² / (2 stops)``. v is the greatest speed that
    it is commanded [m/s].
    """
    able, follows = (1.0 - braking.RESERVE) * braking.weakest(input_set), response.follows
    beyond = max(0.0, follows * speed - min(MOST, SETTLES * able * follows))
    if beyond == 0.0:
        return None
    return 1.0 / (1.0 / able + 2.0 * SOONER * beyond / speed**2) / (1.0 - braking.RESERVE)


def axle_of(command: Command, response: Response, input_set: InputSet, v_max: float) -> Axle | None:
    """Return what limits a differential drive; None of a robot that moves in every direction.

    Its rectangle of inputs turns with the heading, and lies in the largest ball within U. `v_max`
    is the cap on its speed [m/s].
    """
    if command.look_ahead is None:
        return None
    able = min(response.braking, braking.weakest(input_set) / math.sqrt(2.0))
    return Axle(command.look_ahead, min(command.forward, v_max), command.turn, able)
