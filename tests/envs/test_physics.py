"""The plant: what it does is physics, what is random about it is seeded."""

import mujoco
import numpy as np
import pytest

from hcbf_gym.envs.a1_physics import A1Physics
from hcbf_gym.envs.scene import ROUGH_HALF_SIZE, ROUGH_STEP
from hcbf_gym.errors import InvalidInputError, RobotModelError
from hcbf_gym.locomotion.controller import LocomotionController
from hcbf_gym.robots import a1
from hcbf_gym.scenarios import BoxObstacle

MASS = 12.453
RANDOM_PUSHES = {"kind": "random", "interval": 1.0, "impulse": [1.0, 3.0]}


def box_named(name: str) -> BoxObstacle:
    return BoxObstacle(name, (3.0, 3.0), (0.3, 0.3, 0.3))


def fresh(seed: int = 0, **options) -> A1Physics:
    simulation = A1Physics(**options)
    simulation.reset(np.zeros(2), 0.0, np.random.default_rng(seed))
    return simulation


def test_a_new_simulation_has_a_state_before_its_first_reset():
    simulation = A1Physics()
    np.testing.assert_array_equal(simulation.state().vector[:19], simulation.data.qpos)
    assert simulation.state().quaternion @ simulation.state().quaternion == 1.0
    home = fresh().state()
    assert home.position[2] == 0.27
    np.testing.assert_array_equal(home.joint_position, np.tile([0.0, 0.9, -1.8], 4))


def walk(simulation: A1Physics, seconds: float, u=(0.5, 0.0), **options) -> LocomotionController:
    controller = LocomotionController(max_speed=0.6, **options)
    controller.reset(simulation.state())
    for _ in range(round(seconds / simulation.model.opt.timestep)):
        simulation.step(controller.step(simulation.state(), np.array(u)))
    return controller


def centre_of_mass_velocity(simulation: A1Physics) -> np.ndarray:
    mujoco.mj_subtreeVel(simulation.model, simulation.data)
    return simulation.data.subtree_linvel[1].copy()


def test_a_push_in_the_air_changes_the_momentum_by_its_impulse():
    simulation = fresh()
    simulation.data.qpos[2] = 3.0
    force, ticks = np.array([40.0, -25.0, 10.0]), 50
    simulation.push(force)
    for _ in range(ticks):
        simulation.step(np.zeros(12))
    impulse = (force + np.array([0, 0, -9.81 * MASS])) * ticks * 0.002
    np.testing.assert_allclose(MASS * centre_of_mass_velocity(simulation), impulse, atol=1e-3)


def test_a_scheduled_push_lasts_its_duration():
    push = {"time": 0.02, "duration": 0.1, "force": [60.0, 0.0, 0.0]}
    simulation = fresh(disturbances={"kind": "scheduled", "pushes": [push]})
    simulation.data.qpos[2] = 3.0
    for _ in range(100):
        simulation.step(np.zeros(12))
    momentum = MASS * centre_of_mass_velocity(simulation)
    assert momentum[0] == pytest.approx(6.0, rel=0.02)


def test_random_pushes_come_from_the_seed():
    def pushes(seed):
        return fresh(seed, disturbances=RANDOM_PUSHES | {"interval": 2.0})._pushes

    forces = [[push.force[0] for push in pushes(seed)] for seed in (1, 1, 2)]
    assert forces[0] == forces[1] != forces[2]
    assert len(forces[0]) == 10
    strengths = [np.linalg.norm(push.force) * push.duration for push in pushes(3)]
    assert 1.0 <= min(strengths) <= max(strengths) <= 3.0


def test_an_unactuated_robot_falls_and_reports_it():
    simulation = fresh()
    assert not simulation.fallen
    for _ in range(1000):
        simulation.step(np.zeros(12))
    assert simulation.fallen


def test_a_state_that_is_not_finite_counts_as_diverged(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # where MuJoCo leaves a log of its warnings
    simulation = fresh()
    simulation.data.qpos[2] = np.nan
    assert simulation.fallen
    simulation.data.qpos[2], simulation.data.qvel[17] = 0.3, np.nan
    assert not simulation.diverged
    simulation.step(np.zeros(12))
    assert simulation.diverged
    assert simulation.fallen
    simulation.reset(np.zeros(2), 0.0, np.random.default_rng(0))
    assert not simulation.diverged


def test_a_state_s_vector_is_that_of_mujoco_and_its_views_are_its_parts():
    simulation = fresh(terrain="rough")
    walk(simulation, 0.5)
    state, data = simulation.state(), simulation.data
    np.testing.assert_array_equal(state.vector[:37], [*data.qpos, *data.qvel])
    feet = {f"{leg}_foot" for leg in a1.LEGS}
    touching = {simulation.model.geom(geom).name for geom in data.contact.geom.ravel()} & feet
    assert touching == {
        f"{leg}_foot" for leg, on in zip(a1.LEGS, state.foot_contact, strict=True) if on
    }
    names = "position", "quaternion", "joint_position", "linear_velocity", "angular_velocity"
    views = [getattr(state, name) for name in (*names, "joint_velocity", "foot_contact")]
    parts = np.concatenate(views)
    np.testing.assert_array_equal(parts, state.vector)


def test_the_controller_stays_finite_through_a_fall():
    simulation = fresh(
        disturbances={
            "kind": "scheduled",
            "pushes": [{"time": 0.2, "duration": 0.2, "force": [0.0, 900.0, 0.0]}],
        }
    )
    controller = LocomotionController()
    controller.reset(simulation.state())
    fell = False  # it may roll right over
    for _ in range(600):
        torque = controller.step(simulation.state(), np.zeros(2))
        assert np.isfinite(torque).all()
        simulation.step(torque)
        fell |= simulation.fallen
    assert fell


def test_the_robot_walks_as_commanded_and_every_program_is_solved():
    simulation = fresh()
    controller = walk(simulation, 4.0)
    assert not simulation.fallen
    assert (controller.solved, controller.failed) == (2000, 0)
    np.testing.assert_allclose(simulation.base_state[2:], [0.6, 0.0], atol=0.06)
    np.testing.assert_allclose(simulation.base_state[:2], controller.reference.position, atol=0.03)


def test_standing_feet_stay_down():
    simulation = fresh()
    controller = walk(simulation, 1.0, u=(0.0, 0.0), gait="stand")
    assert controller.diagnostics.stance.all()
    assert simulation.state().foot_contact.all()
    assert np.linalg.norm(simulation.base_state[:2]) < 0.005


@pytest.mark.physics
def test_the_robot_crosses_blind_steps():
    simulation = fresh(terrain="rough")
    assert simulation.model.hfield_size[0, 2] == ROUGH_STEP <= 0.03
    walk(simulation, 5.0, u=(0.5, 0.3))
    assert not simulation.fallen
    assert np.linalg.norm(simulation.base_state[:2]) > 2.0


@pytest.mark.physics
def test_the_robot_walks_on_a_plant_that_differs_in_everything():
    simulation = fresh(
        randomization={
            "payload": 4.0,
            "payload_position": [0.06, 0.03, 0.08],
            "motor_strength": 0.9,
            "delay": 0.004,
            "sensor_noise": 1.0,
            "floor_friction": 0.5,
        }
    )
    controller = walk(simulation, 3.0)
    assert not simulation.fallen
    assert controller.failed == 0
    np.testing.assert_allclose(simulation.base_state[:2], controller.reference.position, atol=0.1)


def test_the_plant_is_drawn_within_its_ranges_and_from_the_seed():
    ranges = {"payload": [1.0, 3.0], "floor_friction": [0.4, 0.8], "delay": [0.0, 0.006]}
    plants = [fresh(seed, randomization=ranges).conditions for seed in (0, 0, 1)]
    assert plants[0] == plants[1] != plants[2]
    for plant in plants:
        assert 1.0 <= plant.payload <= 3.0
        assert 0.4 <= plant.floor_friction <= 0.8
        assert plant.motor_strength == 1.0
    simulation = fresh(1, randomization=ranges)
    assert simulation.model.body_subtreemass[1] == pytest.approx(
        MASS + simulation.conditions.payload
    )


def test_a_delayed_torque_arrives_late_and_a_weak_motor_gives_less():
    simulation = fresh(randomization={"delay": 0.004, "motor_strength": 0.5})
    torque = np.arange(12.0)
    arrived = []
    for _ in range(3):
        simulation.step(torque)
        arrived.append(simulation.data.ctrl.copy())
    np.testing.assert_array_equal(arrived, [0 * torque, 0 * torque, 0.5 * torque])


def test_sensor_noise_has_the_stated_size_and_leaves_the_truth_alone():
    simulation = fresh(randomization={"sensor_noise": 1.0})
    states = [simulation.state() for _ in range(2000)]
    spread = [
        np.std([getattr(s, name) for s in states], axis=0).mean()
        for name in (
            "linear_velocity",
            "angular_velocity",
            "joint_velocity",
            "joint_position",
            "position",
        )
    ]
    np.testing.assert_allclose(spread, [0.1, 0.2, 0.6, 0.01, 0.0], rtol=0.05, atol=1e-9)
    np.testing.assert_array_equal(simulation.base_state[:2], [0.0, 0.0])


def test_a_box_reports_the_force_it_is_hit_with():
    box = BoxObstacle("crate", (0.75, 0.0), (0.3, 0.6, 0.4))
    simulation = fresh(obstacles=[box])
    assert simulation.obstacle_forces().tolist() == [0.0]
    controller = LocomotionController()
    controller.reset(simulation.state())
    felt = 0.0
    for _ in range(1000):
        simulation.step(controller.step(simulation.state(), np.array([0.5, 0.0])))
        felt = max(felt, float(simulation.obstacle_forces()[0]))
    assert felt > 1.0
    assert simulation.base_state[0] < 0.75


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("terrain", "moon", "flat.*rough"),
        ("terrain", ["flat"], "flat.*rough"),
        ("timestep", 0.0, "timestep"),
        ("timestep", 1e-9, "timestep"),
        ("xml_file", ["a1.xml"], "a1.xml"),
        ("randomization", ["payload"], "mapping"),
        ("randomization", {"gravity": 1.0}, "gravity.*payload"),
        ("randomization", {"payload": [2.0, 1.0]}, "low <= high"),
        ("randomization", {"payload": [1.0]}, "payload"),
        ("randomization", {"payload": None}, "payload"),
        ("randomization", {"payload": 1e9}, "payload"),
        ("randomization", {"motor_strength": 0.0}, "motor_strength"),
        ("randomization", {"delay": 1e6}, "delay"),
        ("randomization", {"payload_position": [1e3, 0.0, 0.0]}, "payload_p"),
        ("disturbances", {"kind": "wind"}, "random.*scheduled"),
        ("disturbances", {"kind": ["random"]}, "random.*scheduled"),
        ("disturbances", {"kind": "scheduled", "pushes": [{"time": 1.0}]}, "force"),
        ("disturbances", {"kind": "scheduled", "pushes": None}, "a list"),
        ("disturbances", RANDOM_PUSHES | {"impulse": [3.0, 1.0]}, "impulse"),
        ("disturbances", RANDOM_PUSHES | {"interval": 1e-9}, "10000 pushes"),
        ("disturbances", RANDOM_PUSHES | {"interval": -1.0}, "interval"),
        ("disturbances", RANDOM_PUSHES | {"until": 1e12}, "until"),
        ("disturbances", RANDOM_PUSHES | {"duration": 1e9}, "duration"),
        ("disturbances", RANDOM_PUSHES | {"duration": 1e-300}, "impulse"),
        *(
            ("obstacles", [box_named(name) for name in names], f"'{names[-1]}'")
            for names in (["floor"], ["trunk"], ["FR_foot"], ["payload"], ["a", "a"])
        ),
    ],
)
def test_bad_options_are_refused_with_the_choices(option, value, message):
    error = RobotModelError if option == "xml_file" else InvalidInputError
    with pytest.raises(error, match=message):
        A1Physics(**{option: value})


def test_a_robot_with_position_servos_is_driven_by_torques(tmp_path):
    servo = '<position kp="100" name="FR_hip" joint="FR_hip_joint"/>'
    text = a1.XML_FILE.read_text().replace('<motor name="FR_hip" joint="FR_hip_joint"/>', servo)
    assert servo in text
    (tmp_path / "servo.xml").write_text(text)
    simulation, plain = fresh(xml_file=tmp_path / "servo.xml"), fresh()
    for each in (simulation, plain):
        walk(each, 0.1)
    np.testing.assert_array_equal(simulation.data.qpos, plain.data.qpos)


@pytest.mark.physics
def test_the_rough_field_ends_at_a_wall():
    simulation = fresh(terrain="rough")
    simulation.reset(np.array([ROUGH_HALF_SIZE - 1.0, 0.0]), 0.0, np.random.default_rng(0))
    walk(simulation, 4.0)
    assert ROUGH_HALF_SIZE - 0.7 < simulation.base_state[0] < ROUGH_HALF_SIZE
    assert simulation.data.qpos[2] > 0.0  # it has not dropped over the edge
