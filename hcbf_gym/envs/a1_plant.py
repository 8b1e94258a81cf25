"""The A1 that controller and filter assume, derived from the declared ranges of its conditions."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core, certificates, records
from hcbf_gym.arrays import Pair
from hcbf_gym.barriers import braking
from hcbf_gym.barriers.class_k import LogClassK
from hcbf_gym.barriers.speed_limit import check_leaves_speed
from hcbf_gym.envs.plants import PlantModel
from hcbf_gym.envs.randomization import PlantConditions, Randomization
from hcbf_gym.errors import InvalidInputError, LoweredWarning, warn_caller
from hcbf_gym.locomotion.controller import LEAST_FRICTION
from hcbf_gym.locomotion.watch import WatchBounds
from hcbf_gym.models.constants import GRAVITY
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.scenarios import Scenario

# below this cap its row's margin leaves 1.3 m/s, with which the trunk catches up with references
V_MAX = 1.5  # strict cap on the speed where the scenario sets none [m/s]
FASTEST = 1.7  # the highest cap that a scenario may set [m/s]
NOMINAL = Randomization()  # the plant that the controller's model describes

UNCERTAINTY = Uncertainty(
    distance=0.025,
    per_velocity=0.7,
    per_lead=1.5,
    cap=0.25,
    confidence=4.0,
    speed=0.18,
    speed_per_velocity=0.8,
)
"""How far the nominal plant's trunk may be from its reduced-order model, calibrated with the
hostile episodes of docs/guarantees.md."""


class Law(NamedTuple):
    """The growth of the margins with the declared plants, and with the cap v on the speed.

    The distance of the declared plants from the nominal one is w [m], see `_plant_distance`. Rows
    on the position reserve ``cap (v − V_MAX)⁺ + w max(1, v / 1 m/s)`` more than on the nominal
    plant, and the speed limit reserves ``speed w v + ‖u‖ (delay − 2 ms)⁺`` more. No margin covers a
    fall, so a cap above ``FASTEST − cap_lowering w`` is lowered to it.
    """

    cap: float = 0.1  # per cap above `V_MAX` [s]
    rough_ground: float = 0.014  # on rough ground [m]
    friction: float = 0.04  # per friction that the floor lacks [m]
    payload: float = 0.002  # per payload [m/kg]
    motor_strength: float = 0.03  # per share of the torque that is missing [m]
    delay: float = 2.5  # per delay beyond the nominal one [m/s]
    sensor_noise: float = 0.02  # per scale of the sensors' noise [m]
    speed: float = 1.0  # per w v [1/m]
    cap_lowering: float = 10.0  # per w [1/s]


LAW = Law()
"""Calibrated with hostile episodes of `hcbf_lab.certification.mixture`."""

PLANNED_FRICTION_SHARE = 0.75  # of the floor's least friction; the rest is for slips
CARRIED_INPUT_SHARE = 0.85  # of µg for a component of u; the rest holds the trunk on its reference

# the watch's bounds
MAX_SLIP, MAX_LAG, MAX_LIFT = 0.08, 0.2, 0.9  # on the nominal plant [m/s], [-], [m/s²]
SLIP_ON_ROUGH_GROUND = 0.04  # [m/s]
SLIP_OF_ESTIMATE = 0.06  # where the trunk's velocity is estimated [m/s]
SLIP_PER_SENSOR_NOISE = 0.4  # [m/s]
SLIP_PER_DELAY_SQUARED = 2000.0  # per square of the delay beyond the nominal one [m/s³]


def derived_friction(declared: Randomization) -> float:
    """Return µ of the planned contact forces, three quarters of the least that the floor may have.

    It is at most that of the nominal floor: more friction does not let the robot walk better.
    """
    planned = PLANNED_FRICTION_SHARE * declared.floor_friction[0]
    return min(_core.FULL_GRIP, max(LEAST_FRICTION, planned))


def carried_inputs(input_set: InputSet, friction: float) -> InputSet:
    """Return U, shrunk until the ground with this µ carries it: ``|u_i| ≤ 0.85 µ g``."""
    largest = float(np.abs(input_set.vertices()).max())
    share = CARRIED_INPUT_SHARE * friction * GRAVITY / largest
    return input_set if share >= 1.0 else input_set.scaled(share)


def plant_model(
    arguments: Mapping[str, object],
    scenario: Scenario,
    declared: Randomization,
    friction: float,
    reach: float,
) -> PlantModel:
    """Return the model of the A1 that a filter assumes.

    Args:
        arguments: the environment's arguments, as certificates compare them.
        scenario: the first scene.
        declared: the ranges of the plant's conditions.
        friction: µ with which the controller plans.
        reach: distance that the body reaches beyond the trunk's centre [m]; 0 for a point.
    """
    terrain = str(arguments["terrain"])
    input_set = carried_inputs(scenario.input_set, friction)
    v_max = speed_limit(scenario, declared, terrain, input_set)
    uncertainty = uncertainty_of(declared, terrain, reach, input_set, v_max)
    compared = records.plain({
        **arguments,
        **{name: getattr(declared, name) for name in PlantConditions._fields},
        "payload_position": declared.payload_position if declared.payload[1] > 0.0 else None,
        "friction_derived": round(derived_friction(declared), 9),
        "obstacles": len(scenario.obstacles),
        "input_set": round(braking.weakest(input_set), 9),
        "v_max": v_max,
    })  # fmt: skip
    return PlantModel(input_set, v_max, uncertainty, compared, certificates.nearest(compared))


def uncertainty_of(
    declared: Randomization, terrain: str, body: float, input_set: InputSet, v_max: float
) -> Uncertainty:
    """Return how far the robot may be from its reduced-order model; see `Law`.

    Args:
        declared: the ranges of the plant's conditions.
        terrain: "flat" or "rough".
        body: distance that the body reaches beyond the trunk's centre [m]; 0 for a point.
        input_set: U, shrunk to accelerations that the ground carries.
        v_max: the strict cap on the speed [m/s].
    """
    for_speed = LAW.cap * max(0.0, v_max - V_MAX)
    for_plant = max(1.0, v_max) * _plant_distance(declared, terrain)
    at_rest, per_cap = _speed_margin(declared, terrain, input_set)
    uncertainty = UNCERTAINTY._replace(
        distance=UNCERTAINTY.distance + for_speed + for_plant,
        body=body,
        speed=at_rest + per_cap * v_max,
    )
    check_leaves_speed("v_max", v_max, uncertainty.speed)
    return uncertainty


def carried_speed(declared: Randomization, terrain: str, input_set: InputSet) -> float:
    """Return the highest cap on the speed [m/s] that the plant carries.

    It is the cap at which the robot still walks, ``FASTEST − cap_lowering w`` of `LAW`, or the one
    from which U still stops it: a cap v leaves the model the speed ``√(v² − 2 v m)`` after the
    margin ``m = m₀ + k v`` of its row, and `braking.stoppable` has to be as much.
    """
    walkable = FASTEST - LAW.cap_lowering * _plant_distance(declared, terrain)
    if walkable <= 0.0:
        return 0.0
    at_rest, per_cap = _speed_margin(declared, terrain, input_set)
    # v is the positive root of (1 − 2 k) v² − 2 m₀ v = stoppable²
    quadratic = 1.0 - 2.0 * per_cap
    stoppable = braking.stoppable(LogClassK(), input_set)
    brakable = (at_rest + math.hypot(at_rest, math.sqrt(quadratic) * stoppable)) / quadratic
    return math.floor(1e3 * min(walkable, brakable)) / 1e3


def _speed_margin(declared: Randomization, terrain: str, input_set: InputSet) -> Pair:
    """Return m₀ [m/s] and k [-] of the speed limit's margin m₀ + k v, with v the cap.

    While a torque is delayed, u changes the model's velocity and not yet the trunk's.
    """
    unfollowed = _extra_delay(declared) * input_set.radius
    return UNCERTAINTY.speed + unfollowed, LAW.speed * _plant_distance(declared, terrain)


def _plant_distance(declared: Randomization, terrain: str) -> float:
    """Return w of `Law` [m], the distance of the declared plants from the nominal one."""
    return (
        LAW.rough_ground * (terrain != "flat")
        + LAW.friction * max(0.0, NOMINAL.floor_friction[0] - declared.floor_friction[0])
        + LAW.payload * declared.payload[1]
        + LAW.motor_strength * max(0.0, NOMINAL.motor_strength[0] - declared.motor_strength[0])
        + LAW.delay * _extra_delay(declared)
        + LAW.sensor_noise * declared.sensor_noise[1]
    )


def _extra_delay(declared: Randomization) -> float:
    """Return how much later than on the nominal plant a torque may come [s]."""
    return max(0.0, declared.delay[1] - NOMINAL.delay[1])


def watch_bounds(
    declared: Randomization, terrain: str, estimated: bool, mass: float
) -> WatchBounds:
    """Return how large the watch's signals may be on the declared plants.

    A payload p and motors of strength s need the lift ``g ((1 + p / m) / s − 1)``.

    Args:
        declared: the ranges of the plant's conditions.
        terrain: "flat" or "rough".
        estimated: whether the trunk's velocity is an estimate.
        mass: m, the mass of the robot [kg].
    """
    noise, extra_delay = declared.sensor_noise[1], _extra_delay(declared)
    slip = MAX_SLIP + SLIP_ON_ROUGH_GROUND * (terrain == "rough") + SLIP_OF_ESTIMATE * estimated
    slip += SLIP_PER_SENSOR_NOISE * noise + SLIP_PER_DELAY_SQUARED * extra_delay**2
    delay = max(declared.delay[1], NOMINAL.delay[1])
    loaded = (1.0 + declared.payload[1] / mass) / min(declared.motor_strength[0], 1.0) - 1.0
    return WatchBounds(slip=slip, lag=MAX_LAG, lift=MAX_LIFT + GRAVITY * loaded, delay=delay)


def speed_limit(
    scenario: Scenario, declared: Randomization, terrain: str, input_set: InputSet
) -> float:
    """Return the scenario's cap on the speed [m/s], lowered with a warning to `carried_speed`.

    Raises:
        InvalidInputError: if the scenario's cap is above `FASTEST`.
    """
    cap = V_MAX if scenario.v_max is None else scenario.v_max
    if cap > FASTEST:
        raise InvalidInputError(
            f"{scenario.name}: v_max: got {cap} m/s, expected at most {FASTEST} for the A1"
        )
    carried = carried_speed(declared, terrain, input_set)
    if cap <= carried:
        return cap
    warn_caller(
        f"HCBF-A1Regions-v0: v_max: {cap} m/s is lowered to {carried} m/s, the highest cap that "
        f"the declared plant carries: U stops it with {braking.weakest(input_set):.3g} m/s² in its "
        "weakest direction",
        LoweredWarning,
    )
    return carried
