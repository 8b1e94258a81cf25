"""What controller and filter assume of the A1 and its ground, from what is declared."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hcbf_gym import _core, certificates, records
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

V_MAX = 1.5
"""Strict cap on the speed [m/s] where the scenario sets none; its row holds the trunk below some
1.3 m/s, so that the paper's courses can be caught up with."""

FASTEST = 1.7
"""The highest cap [m/s] that a scenario may set."""

NOMINAL = Randomization()

UNCERTAINTY = Uncertainty(
    distance=0.025,
    per_velocity=0.7,
    per_lead=1.5,
    cap=0.25,
    confidence=4.0,
    speed=0.18,
    speed_per_velocity=0.8,
)
"""The trunk's distance from its reduced-order model, calibrated with the hostile episodes of
docs/guarantees.md."""


class Law(NamedTuple):
    """How the margins grow with what is declared, and with the cap on the speed v.

    Rows on the position reserve ``fast max(0, v − V_MAX) + w max(1, v / 1 m/s)`` more than on the
    nominal plant, the speed limit ``share w v + ‖u‖ late``, with late the torque's delay beyond the
    nominal one and w the sum of the other terms, each times how far its range leaves the nominal
    plant. No margin covers a fall: a cap above ``FASTEST − slower w`` is lowered to it.
    """

    fast: float = 0.1  # of the cap above `V_MAX` [s]
    rough: float = 0.014  # of rough ground [m]
    slippery: float = 0.04  # of the friction that the floor lacks [m]
    payload: float = 0.002  # [m/kg]
    weak: float = 0.03  # of the share of the torque that is missing [m]
    late: float = 2.5  # of the delay [m/s]
    noise: float = 0.02  # of the scale of the sensors' noise [m]
    share: float = 1.0  # of w v [1/m]
    slower: float = 10.0  # of w [1/s]


LAW = Law()
"""Calibrated with hostile episodes of `hcbf_lab.certification.mixture`."""

PLANNED = 0.75
"""Share of the floor's least friction that the controller plans with: the rest is for slips."""

CARRIED = 0.85
"""Share of µg that a component of u may take: the rest holds the trunk on its reference."""

SLIP, LAG, LIFT = 0.08, 0.2, 0.9
"""The watch's bounds: of slip on the nominal plant [m/s], of lag, and of lift beyond what is
declared [m/s²]."""

ROUGH_SLIP, ESTIMATED_SLIP, NOISY_SLIP, LATE_SLIP = 0.04, 0.06, 0.4, 2000.0
"""What adds to it: rough ground, an estimated velocity, sensor noise of 1 [m/s], and the square of
the delay [m/s³]."""


def derived_friction(declared: Randomization) -> float:
    """Return µ of the contact forces: three quarters of the least that the floor may have.

    It is no more than the nominal floor's, on which the robot walks as well as it can.
    """
    return min(_core.FULL_GRIP, max(LEAST_FRICTION, PLANNED * declared.floor_friction[0]))


def carried_inputs(input_set: InputSet, friction: float) -> InputSet:
    """Return U, shrunk until the ground with this µ carries it: ``|u_i| ≤ .85 µ g``."""
    largest = float(np.abs(input_set.vertices()).max())
    share = CARRIED * friction * GRAVITY / largest
    return input_set if share >= 1.0 else input_set.scaled(share)


def plant_model(
    arguments: Mapping[str, object],
    scenario: Scenario,
    declared: Randomization,
    friction: float,
    reach: float,
) -> PlantModel:
    """Return what a filter assumes of the A1.

    Args:
        arguments: of the environment, as certificates compare them.
        scenario: the first scene.
        declared: the ranges of the plant's conditions.
        friction: µ that the controller plans with.
        reach: of the robot beyond its trunk's centre [m]; 0 for a point.
    """
    terrain = str(arguments["terrain"])
    input_set = carried_inputs(scenario.input_set, friction)
    v_max = speed_limit(scenario, declared, terrain, input_set)
    uncertainty = uncertainty_of(declared, terrain, reach, input_set, v_max)
    stated = records.plain({
        **arguments,
        **{name: getattr(declared, name) for name in PlantConditions._fields},
        "payload_position": declared.payload_position if declared.payload[1] > 0.0 else None,
        "friction_derived": round(derived_friction(declared), 9),
        "obstacles": len(scenario.obstacles),
        "input_set": round(braking.weakest(input_set), 9),
        "v_max": v_max,
    })  # fmt: skip
    return PlantModel(input_set, v_max, uncertainty, stated, certificates.nearest(stated))


def uncertainty_of(
    declared: Randomization, terrain: str, body: float, input_set: InputSet, v_max: float
) -> Uncertainty:
    """Return how far the robot may be from its reduced-order model; see `Law`.

    The body reaches so far beyond the trunk's centre [m], 0 for a point; U is what the ground
    carries, `v_max` the strict cap on the speed [m/s].
    """
    fast = LAW.fast * max(0.0, v_max - V_MAX)
    still, growing = _speed_margin(declared, terrain, input_set)
    known = UNCERTAINTY._replace(
        distance=UNCERTAINTY.distance + fast + max(1.0, v_max) * _unlike(declared, terrain),
        body=body,
        speed=still + growing * v_max,
    )
    check_leaves_speed("v_max", v_max, known.speed)
    return known


def carried_speed(declared: Randomization, terrain: str, input_set: InputSet) -> float:
    """Return the highest cap on the speed [m/s] that the plant carries.

    It is ``FASTEST − slower w`` of `LAW`, or less where U could not stop the robot: a cap v leaves
    the model ``√(v² − 2 v m)`` after the margin m of its row, no more than `braking.stoppable`.
    """
    walked = FASTEST - LAW.slower * _unlike(declared, terrain)
    if walked <= 0.0:
        return 0.0
    still, growing = _speed_margin(declared, terrain, input_set)
    steep = 1.0 - 2.0 * growing  # steep v² − 2 still v = stoppable²
    stoppable = braking.stoppable(LogClassK(), input_set)
    stopped = (still + math.hypot(still, math.sqrt(steep) * stoppable)) / steep
    return math.floor(1e3 * min(walked, stopped)) / 1e3


def _speed_margin(
    declared: Randomization, terrain: str, input_set: InputSet
) -> tuple[float, float]:
    """Return what the speed limit reserves at rest [m/s], and more for each m/s of the cap [-].

    A torque that comes late leaves the trunk with the velocity that u changed meanwhile.
    """
    changed = _late(declared) * input_set.radius
    return UNCERTAINTY.speed + changed, LAW.share * _unlike(declared, terrain)


def _unlike(declared: Randomization, terrain: str) -> float:
    """Return w of `Law` [m], the distance of the declared plants from the nominal one."""
    return (
        LAW.rough * (terrain != "flat")
        + LAW.slippery * max(0.0, NOMINAL.floor_friction[0] - declared.floor_friction[0])
        + LAW.payload * declared.payload[1]
        + LAW.weak * max(0.0, NOMINAL.motor_strength[0] - declared.motor_strength[0])
        + LAW.late * _late(declared)
        + LAW.noise * declared.sensor_noise[1]
    )


def _late(declared: Randomization) -> float:
    """Return how much later than on the nominal plant a torque may come [s]."""
    return max(0.0, declared.delay[1] - NOMINAL.delay[1])


def watch_bounds(
    declared: Randomization, terrain: str, estimated: bool, mass: float
) -> WatchBounds:
    """Return how large the watch's signals may be on the plants that are declared.

    A payload p and motors of strength s need the lift ``g ((1 + p / m) / s − 1)``.

    Args:
        declared: the ranges of the plant's conditions.
        terrain: "flat" or "rough".
        estimated: whether the trunk's velocity is an estimate.
        mass: m of the robot [kg].
    """
    slip = SLIP + ROUGH_SLIP * (terrain == "rough") + ESTIMATED_SLIP * estimated
    slip += NOISY_SLIP * declared.sensor_noise[1] + LATE_SLIP * _late(declared) ** 2
    delay = max(declared.delay[1], NOMINAL.delay[1])
    loaded = (1.0 + declared.payload[1] / mass) / min(declared.motor_strength[0], 1.0) - 1.0
    return WatchBounds(slip=slip, lag=LAG, lift=LIFT + GRAVITY * loaded, delay=delay)


def speed_limit(
    scenario: Scenario, declared: Randomization, terrain: str, input_set: InputSet
) -> float:
    """Return the strict cap on the speed [m/s]: the scenario's, or with a warning what is carried.

    Raises:
        InvalidInputError: if the scenario's is more than the A1 walks.
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
