"""What the A1's controller and filter assume, from what the arguments declare."""

import re
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from hcbf_gym import scenarios, wrappers
from hcbf_gym.barriers import BarrierSet, Ellipse, LogClassK, braking
from hcbf_gym.envs import a1_plant
from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.errors import InvalidInputError, LoweredWarning
from hcbf_gym.models import Ball, Box
from hcbf_gym.models.constants import GRAVITY
from hcbf_gym.robots import a1

NOMINAL = Randomization()


def inner(**options):
    return gym.make("HCBF-A1Regions-v0", **{"scenario": "random"} | options).unwrapped


def test_the_nominal_plant_keeps_its_inputs_and_margins():
    plant = inner().plant
    np.testing.assert_array_equal(plant.input_set.vertices(), Box.symmetric(5.0).vertices())
    assert plant.uncertainty == a1_plant.UNCERTAINTY
    assert a1_plant.derived_friction(NOMINAL) == 0.6


@pytest.mark.parametrize("input_set", [Box.symmetric(5.0), Ball(4.0), Box([-1.0, 0.0], [6.0, 2.0])])
def test_no_input_exceeds_what_the_ground_carries(input_set):
    for friction in (0.1, 0.3, 0.6):
        carried = a1_plant.carried_inputs(input_set, friction).vertices()
        assert np.abs(carried).max() < friction * GRAVITY
        share = np.abs(carried).max() / np.abs(input_set.vertices()).max()
        np.testing.assert_allclose(carried, share * input_set.vertices())


def test_the_least_friction_that_is_declared_is_what_counts():
    declared = Randomization(floor_friction=(0.4, 1.0))
    assert a1_plant.derived_friction(declared) == pytest.approx(0.3)
    slippery = inner(randomization={"floor_friction": [0.4, 0.8]})
    with pytest.warns(UserWarning, match=r"friction 0\.6 \(tested: at most three quarters"):
        given = inner(randomization={"floor_friction": [0.4, 0.8]}, friction=0.6)
    assert slippery.plant.input_set.radius == pytest.approx(0.5 * Box.symmetric(5.0).radius, 1e-3)
    assert given.plant.input_set.radius == Box.symmetric(5.0).radius
    assert slippery.action_space == given.action_space


def test_the_filter_exceeds_no_input_that_a_slippery_floor_carries():
    env = wrappers.SafetyFilter(inner(randomization={"floor_friction": 0.4}), program="lex-cbf-qp")
    env.reset(seed=0)
    _, _, _, _, info = env.step(np.array([5.0, -5.0]))
    assert np.abs(info["safety_filter"]["u_safe"]).max() <= 0.3 * GRAVITY


def margins(v_max=1.0, terrain="flat", body=0.0, **ranges):
    declared = Randomization(**ranges)
    return a1_plant.uncertainty_of(declared, terrain, body, Box.symmetric(5.0), v_max)


OFF_NOMINAL = {
    "floor_friction": [(0.8, 0.8), (0.6, 0.8), (0.4, 0.8)],
    "payload": [(0.0, 0.0), (0.0, 2.0), (0.0, 4.0)],
    "motor_strength": [(1.0, 1.0), (0.9, 1.0), (0.8, 1.0)],
    "delay": [(0.0, 0.002), (0.0, 0.005), (0.0, 0.008)],
    "sensor_noise": [(0.0, 0.0), (0.0, 0.2), (0.0, 0.5)],
}


@pytest.mark.parametrize("name", OFF_NOMINAL)
def test_margins_grow_with_the_range_and_with_the_cap_and_the_carried_cap_falls(name):
    box = Box.symmetric(5.0)
    for terrain in ("flat", "rough"):
        ladder = [{name: ends} for ends in OFF_NOMINAL[name]]
        known = [margins(terrain=terrain, **step) for step in ladder]
        faster = [margins(1.7, terrain, **step) for step in ladder]
        carried = [a1_plant.carried_speed(Randomization(**step), terrain, box) for step in ladder]
        for reserved in (known, faster):
            assert np.all(np.diff([one.distance for one in reserved]) > 0.0)
            assert np.all(np.diff([one.speed for one in reserved]) > 0.0)
        assert np.all(np.diff(carried) < 0.0)
    assert margins(**ladder[0]) == a1_plant.UNCERTAINTY
    assert known[-1].distance < faster[-1].distance
    assert known[-1].speed < faster[-1].speed


def test_the_start_and_a_better_plant_than_the_nominal_one_cost_nothing():
    better = {"floor_friction": (1.0, 1.0), "delay": (0.0, 0.0), "motor_strength": (1.2, 1.2)}
    assert margins(start_distance=(0.0, 0.3), **better) == a1_plant.UNCERTAINTY
    assert margins(body=0.46).body == 0.46


def test_a_torque_that_comes_late_leaves_the_velocity_that_u_changed_meanwhile():
    late = margins(delay=(0.0, 0.008)).speed - a1_plant.UNCERTAINTY.speed
    assert late > 0.006 * np.hypot(5.0, 5.0)


def test_a_cap_above_the_usual_one_widens_the_margin_on_the_position_and_no_lower_one_does():
    assert margins(0.5) == margins(a1_plant.V_MAX) == a1_plant.UNCERTAINTY
    wider = margins(a1_plant.FASTEST).distance - a1_plant.UNCERTAINTY.distance
    assert wider == pytest.approx(0.02)


@pytest.mark.parametrize("friction", [0.4, 0.6, 0.8])
def test_from_the_cap_that_is_carried_u_stops_the_robot(friction):
    declared = Randomization(floor_friction=(friction, friction), delay=(0.0, 0.008))
    planned = a1_plant.derived_friction(declared)
    carried = a1_plant.carried_inputs(Box.symmetric(5.0), planned)
    cap = a1_plant.carried_speed(declared, "rough", carried)
    known = a1_plant.uncertainty_of(declared, "rough", 0.0, carried, cap)
    stopped = braking.stoppable(LogClassK(), carried)
    assert braking.speed_left(cap, known.speed) <= stopped
    assert cap <= a1_plant.FASTEST


def test_a_cap_that_the_plant_does_not_carry_is_lowered_with_a_warning():
    with pytest.warns(LoweredWarning, match=r"1\.5 m/s is lowered to 1\.1\d* m/s"):
        env = inner(scenario="paper-simulation", randomization={"floor_friction": 0.4})
    assert 1.0 < env.barriers[-1].v_max < 1.2
    with pytest.raises(InvalidInputError, match="no speed is left"), pytest.warns(LoweredWarning):
        inner(randomization={"sensor_noise": 100.0})


def test_the_body_s_circle_holds_what_is_fixed_to_the_trunk_and_the_stride(tmp_path):
    def radius(**options):
        return inner(body="footprint", **options).plant.uncertainty.body

    assert 0.455 <= radius() <= 0.47
    with pytest.warns(UserWarning, match="payload_position"):
        loaded = radius(randomization={"payload": 1.0, "payload_position": [0.6, 0.0, 0.1]})
    assert loaded > np.hypot(0.6 + 0.06, 0.05)
    text = a1.XML_FILE.read_text(encoding="utf-8")
    arm = '<geom name="arm" type="capsule" fromto="0.2 0 0.05 0.7 0 0.05" size="0.02" mass="0.1"/>'
    trunk = re.search(r'<body name="trunk"[^>]*>', text)
    assert trunk is not None
    file = tmp_path / "arm.xml"
    file.write_text(text.replace(trunk.group(), trunk.group() + arm), encoding="utf-8")
    with pytest.warns(UserWarning, match="xml_file"):
        assert radius(xml_file=str(file)) > 0.72


def test_a_cap_that_the_margin_eats_is_refused():
    scene = scenarios.make("random")
    for v_max in (0.1, 0.36):
        with pytest.raises(InvalidInputError, match=r"expected above 0\.36"):
            gym.make("HCBF-A1Regions-v0", scenario=replace(scene, v_max=v_max))


def test_the_body_near_a_long_ellipse_is_as_near_as_its_metres_say():
    body = inner(scenario=scenarios.make("random"), body="footprint")
    body.reset(seed=0)
    reed = Ellipse("reed", 1, center=(0.0, 1.2), semi_axes=(4.0, 0.2), angle=np.pi / 2)
    tip = BarrierSet([(replace(reed, center=(0.0, 4.6)),)])  # the robot stands .6 m before its tip
    h = body.drive._footprint.h(body.data, tip, 0.0)
    centre = tip.values(np.zeros((1, 4)), np.zeros(1))[0]
    assert centre[0] == pytest.approx(0.6)  # h is the signed distance
    assert 0.6 - body.plant.uncertainty.body <= h[0] < 0.6
