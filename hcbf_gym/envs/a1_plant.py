"""What controller and filter believe of the A1 and its ground, from what is declared."""

import numpy as np

from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.errors import InvalidInputError
from hcbf_gym.locomotion.controller import LEAST_FRICTION
from hcbf_gym.locomotion.tick import FULL_GRIP
from hcbf_gym.locomotion.watch import WatchBounds
from hcbf_gym.models.constants import GRAVITY
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.scenarios import Scenario

V_MAX = 1.5
"""Strict cap on the speed [m/s] where the scenario sets none; its row holds the trunk below some
1.3 m/s, so that the paper's courses can be caught up with."""

FASTEST = 1.7
"""The highest cap [m/s] that a scenario may set."""

UNCERTAINTY = Uncertainty(
    distance=0.025,
    per_velocity=0.7,
    per_lead=1.5,
    cap=0.25,
    confidence=4.0,
    speed=0.18,
    speed_per_velocity=0.8,
)
"""What the trunk does beside its reduced-order model, calibrated with the hostile episodes of
docs/guarantees.md."""

OFF_NOMINAL = 0.02
"""What rows reserve besides [m], and the speed limit's [m/s], where the arguments declare a plant
unlike the nominal one: rough ground, or a randomisation of more than the start."""

PER_SPEED = 0.1
"""What rows reserve besides [m] for each m/s of the cap above `V_MAX`."""

BODIES = ("point", "footprint")
"""What must stay outside: the trunk's centre, or the whole robot."""

BELIEVED = 0.75
"""Share of the floor's least friction that the controller believes: the rest is for slips."""

CARRIED = 0.85
"""Share of µg that a component of u may take: the rest holds the trunk on its reference."""

SLIP = 0.08
"""The watch's bound of slip on the nominal plant [m/s]."""

ROUGH_SLIP, ESTIMATED_SLIP, NOISY_SLIP, LATE_SLIP = 0.04, 0.06, 0.4, 2000.0
"""What adds to it: rough ground, an estimated velocity, sensor noise of 1 [m/s], and the square of
the delay [m/s³]."""

LAG = 0.2
"""The watch's bound of lag."""

LIFT = 0.9
"""The watch's bound of lift beyond what is declared [m/s²]."""


def believed_friction(declared: Randomization) -> float:
    """Return µ of the contact forces: three quarters of the least that the floor may have.

    More than the nominal floor's, on which the robot walks as well as it can, is not believed.
    """
    return min(FULL_GRIP, max(LEAST_FRICTION, BELIEVED * declared.floor_friction[0]))


def carried_inputs(input_set: InputSet, friction: float) -> InputSet:
    """Return U, shrunk until the ground carries it: ``|u_i| ≤ .85 µ g``.

    Args:
        input_set: of the scenario.
        friction: µ that is believed.
    """
    largest = float(np.abs(input_set.vertices()).max())
    share = CARRIED * friction * GRAVITY / largest
    return input_set if share >= 1.0 else input_set.scaled(share)


def uncertainty_of(
    declared: Randomization, terrain: str, body: float, input_set: InputSet, v_max: float
) -> Uncertainty:
    """Return how far the robot may be from its reduced-order model.

    A torque that comes Δτ later than on the nominal plant leaves the trunk with the velocity that u
    changed meanwhile, ``‖u‖ Δτ``, which the speed limit reserves besides.

    Args:
        declared: what the plant's conditions are drawn from.
        terrain: "flat" or "rough".
        body: what the robot reaches beyond its trunk's centre [m]; 0 for a point.
        input_set: U.
        v_max: the strict cap on the speed [m/s].

    Raises:
        InvalidInputError: if the margin of the speed limit leaves no speed.
    """
    late = max(0.0, declared.delay[1] - Randomization().delay[1])
    known = UNCERTAINTY._replace(
        distance=UNCERTAINTY.distance + PER_SPEED * max(0.0, v_max - V_MAX),
        body=body,
        speed=UNCERTAINTY.speed + late * input_set.radius,
    )
    if terrain != "flat" or declared.off_nominal:
        known = known._replace(
            distance=known.distance + OFF_NOMINAL, speed=known.speed + OFF_NOMINAL
        )
    if v_max <= 2.0 * known.speed:
        raise InvalidInputError(
            f"v_max: got {v_max} m/s, expected above {2.0 * known.speed:g} m/s: the row of the "
            f"speed limit reserves {known.speed:g} m/s, so that no speed is left"
        )
    return known


def watch_bounds(
    declared: Randomization, terrain: str, estimated: bool, mass: float
) -> WatchBounds:
    """Return how large the watch's signals may be on the plants that are declared.

    A payload p and motors of strength s ask for the lift ``g ((1 + p / m) / s − 1)``.

    Args:
        declared: what the plant's conditions are drawn from.
        terrain: "flat" or "rough".
        estimated: whether the trunk's velocity is an estimate.
        mass: m of the robot [kg].
    """
    nominal = Randomization().delay[1]
    delay = max(declared.delay[1], nominal)
    slip = SLIP + ROUGH_SLIP * (terrain == "rough") + ESTIMATED_SLIP * estimated
    slip += NOISY_SLIP * declared.sensor_noise[1] + LATE_SLIP * (delay - nominal) ** 2
    loaded = (1.0 + declared.payload[1] / mass) / min(declared.motor_strength[0], 1.0) - 1.0
    return WatchBounds(slip=slip, lag=LAG, lift=LIFT + GRAVITY * loaded, delay=delay)


def speed_limit(scenario: Scenario) -> float:
    """Return the strict cap on the speed [m/s].

    Raises:
        InvalidInputError: if the scenario's is more than the A1 walks.
    """
    v_max = V_MAX if scenario.v_max is None else scenario.v_max
    if v_max > FASTEST:
        raise InvalidInputError(
            f"{scenario.name}: v_max: got {v_max} m/s, expected at most {FASTEST} for the A1"
        )
    return v_max
