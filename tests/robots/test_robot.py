"""The A1's model: the controller's agrees with what MuJoCo simulates."""

# ruff: noqa: N806 - matrices keep their usual capitals

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from benchmarks.judges.task_space import foot_drift, foot_jacobian
from hcbf_gym._core import inverse_kinematics, rigid_body_terms, rotation_matrix
from hcbf_gym.arrays import packed
from hcbf_gym.envs.a1_physics import A1Physics
from hcbf_gym.errors import RobotModelError
from hcbf_gym.locomotion.controller import LocomotionController
from hcbf_gym.locomotion.leg import foot_kinematics
from hcbf_gym.locomotion.model import RobotModel
from hcbf_gym.locomotion.records import BODIES, LEGS
from hcbf_gym.locomotion.state import STATE_SIZE, RobotState
from hcbf_gym.robots import a1
from hcbf_gym.robots.reader import read_robot

ROBOT = read_robot()
MODEL = RobotModel(ROBOT)
PACKED_LEGS = packed(MODEL.legs, LEGS)


def random_state(seed: int) -> RobotState:
    rng = np.random.default_rng(seed)
    quaternion = rng.standard_normal(4)
    lower = np.tile([-0.8, -1.0, -2.69], 4)
    upper = np.tile([0.8, 4.0, -0.92], 4)
    state = RobotState(np.zeros(STATE_SIZE))
    state.position[:] = rng.standard_normal(3)
    state.quaternion[:] = quaternion / np.linalg.norm(quaternion)
    state.linear_velocity[:] = rng.standard_normal(3)
    state.angular_velocity[:] = 3.0 * rng.standard_normal(3)
    state.joint_position[:] = rng.uniform(lower, upper)
    state.joint_velocity[:] = 5.0 * rng.standard_normal(12)
    return state


def generalised_velocity(state: RobotState) -> tuple[np.ndarray, np.ndarray]:
    """Return R and Pinocchio's v: the trunk's velocity in its own axes, then the joints."""
    R = rotation_matrix(state.quaternion)
    return R, np.concatenate(
        [R.T @ state.linear_velocity, state.angular_velocity, state.joint_velocity]
    )


def mujoco_at(state: RobotState):
    simulation = A1Physics()
    simulation.data.qpos[:] = [*state.position, *state.quaternion, *state.joint_position]
    simulation.data.qvel[:] = [
        *state.linear_velocity,
        *state.angular_velocity,
        *state.joint_velocity,
    ]
    mujoco.mj_forward(simulation.model, simulation.data)
    return simulation.model, simulation.data


@pytest.mark.parametrize("seed", range(5))
def test_mass_matrix_and_bias_agree_with_mujoco(seed):
    state = random_state(seed)
    R, v = generalised_velocity(state)
    bodies = packed(MODEL.bodies, BODIES)
    M, bias = rigid_body_terms(bodies, PACKED_LEGS, R, v, state.joint_position)
    bias[6:] -= MODEL.bodies.dry_friction * np.tanh(v[6:] / 0.1)  # a constraint in MuJoCo
    assert MODEL.bodies.dry_friction.min() > 0.0
    model, data = mujoco_at(state)
    T = np.eye(18)  # MuJoCo's velocities from ours: the trunk's linear one in the world
    T[:3, :3] = R
    M_mujoco = np.zeros((18, 18))
    mujoco.mj_fullM(model, data, M_mujoco)
    np.testing.assert_allclose(M, T.T @ M_mujoco @ T, atol=1e-9)
    rotating_axes = np.zeros(18)  # Ṫ v
    rotating_axes[:3] = R @ np.cross(v[3:6], v[:3])
    forces = data.qfrc_bias - data.qfrc_passive + M_mujoco @ rotating_axes
    np.testing.assert_allclose(bias, T.T @ forces, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_foot_jacobians_and_their_drift_agree_with_mujoco(seed):
    state = random_state(seed)
    R, v = generalised_velocity(state)
    feet = foot_kinematics(MODEL.legs, state.joint_position, state.joint_velocity)
    model, data = mujoco_at(state)
    v_mujoco = np.concatenate([state.linear_velocity, v[3:]])
    to_mujoco = np.eye(18)
    to_mujoco[:3, :3] = R
    rotating_axes = np.zeros(18)
    rotating_axes[:3] = R @ np.cross(v[3:6], v[:3])
    for foot, leg in enumerate(a1.LEGS):
        calf = model.body(f"{leg}_calf").id
        place = state.position + R @ feet.position[foot]
        expected = data.xpos[calf] + data.xmat[calf].reshape(3, 3) @ [0, 0, -ROBOT.calf]
        np.testing.assert_allclose(place, expected, atol=1e-9)

        J, J_dot = np.zeros((3, 18)), np.zeros((3, 18))
        mujoco.mj_jac(model, data, J, None, place, calf)
        mujoco.mj_jacDot(model, data, J_dot, None, place, calf)
        ours = foot_jacobian(R, feet, foot)
        np.testing.assert_allclose(ours, J @ to_mujoco, atol=1e-9)

        drift = foot_drift(R, v, feet, foot)
        np.testing.assert_allclose(drift, J_dot @ v_mujoco + J @ rotating_axes, atol=1e-9)


@settings(deadline=None)
@given(
    leg=st.integers(0, 3),
    abad=st.floats(-0.8, 0.8),
    hip=st.floats(-0.6, 2.0),
    knee=st.floats(-2.69, -0.92),
)
def test_inverse_kinematics_undoes_the_forward_one(leg, abad, hip, knee):
    joints = np.tile(ROBOT.home_joints[:3], 4)
    joints[3 * leg : 3 * leg + 3] = abad, hip, knee
    foot = foot_kinematics(MODEL.legs, joints, np.zeros(12)).position[leg]
    assume((foot - MODEL.legs.hip[leg])[2] < -0.1)  # the branch a walking leg is on
    found = inverse_kinematics(PACKED_LEGS, leg, foot)
    joints[3 * leg : 3 * leg + 3] = found
    back = foot_kinematics(MODEL.legs, joints, np.zeros(12)).position[leg]
    np.testing.assert_allclose(back, foot, atol=1e-9)


@settings(deadline=None)
@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_inverse_kinematics_answers_any_target_with_finite_joints(target):
    assert np.isfinite(inverse_kinematics(PACKED_LEGS, 0, np.array(target))).all()


def test_the_package_robot_weighs_as_much_as_the_public_models():
    assert MODEL.bodies.mass.sum() == pytest.approx(12.453, abs=1e-9)
    assert A1Physics().model.body_subtreemass[1] == pytest.approx(12.453, abs=1e-9)


def edited(tmp_path: Path, old: str, new: str) -> Path:
    path = tmp_path / "robot.xml"
    text = a1.XML_FILE.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return path


def go1(tmp_path: Path) -> Path:
    """Return a file with the lengths, feet and motors of a Unitree Go1."""
    text = a1.XML_FILE.read_text()
    for old, new in (
        ('_calf" pos="0 0 -0.2">', '_calf" pos="0 0 -0.213">'),
        ('size="0.02" pos="0 0 -0.2"', 'size="0.023" pos="0 0 -0.213"'),
        ('actuatorfrcrange="-33.5 33.5"', 'actuatorfrcrange="-23.7 23.7"'),
        (
            '<joint range="-2.69653 -0.916298"/>',
            '<joint range="-2.69653 -0.916298" actuatorfrcrange="-35.55 35.55"/>',
        ),
    ):
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "go1.xml"
    path.write_text(text)
    return path


def test_another_robot_is_read_with_its_own_lengths_feet_and_motors(tmp_path):
    robot = read_robot(go1(tmp_path))
    legs = RobotModel(robot).legs
    assert (legs.thigh, legs.calf, robot.foot_radius) == (0.213, 0.213, 0.023)
    np.testing.assert_array_equal(robot.stall_torque, np.tile([23.7, 23.7, 35.55], 4))


@pytest.mark.physics
def test_another_robot_walks_at_its_own_height_within_its_own_limits(tmp_path):
    path = go1(tmp_path)
    simulation, controller = A1Physics(path), LocomotionController(path, max_speed=0.6)
    simulation.reset(np.zeros(2), 0.0, np.random.default_rng(0))
    controller.reset(simulation.state())
    limits = controller.robot.stall_torque
    for _ in range(1500):
        simulation.step(controller.step(simulation.state(), np.array([0.5, 0.0])))
        assert (np.abs(simulation.data.ctrl) <= limits).all()
    assert not simulation.fallen
    np.testing.assert_allclose(simulation.base_state[2:], [0.6, 0.0], atol=0.06)
    assert simulation.data.qpos[2] == pytest.approx(controller.robot.home_height, abs=0.005)


FOOT = '<geom name="RL_foot" class="foot"/>'
CALF = '<body name="FR_calf" pos="0 0 -0.2">'
REFUSED = [
    ("FR_calf_joint", "front_right_knee", r"front_right_knee.*FR_calf_joint"),
    (CALF, CALF.replace("0 0", ".1 0"), "straight below"),
    (FOOT, "", "RL_calf"),
    ("<option ", '<option gravity="0 0 0" ', "gravity"),
    ("<option ", '<option gravity="0 0 9.81" ', "gravity"),
    ('<freejoint name="base"/>', "", "home"),
    ("<worldbody>", '<worldbody><geom name="floor" type="plane" size="0 0 1"/>', "alone"),
    ('mass="4.713"', 'mass="nan"', "xml_file"),
    ('mass="4.713"', 'mass="0"', "xml_file"),
    ('mass="4.713"', 'mass="1e6"', "knees"),
    ("<worldbody>", '<asset><mesh name="shell" file="no.obj"/></asset><worldbody>', r"no\.obj"),
    ("</mujoco>", "", r"robot\.xml"),
]


@pytest.mark.parametrize(("old", "new", "message"), REFUSED)
def test_a_file_that_is_no_robot_on_the_ground_is_refused(tmp_path, monkeypatch, old, new, message):
    path = edited(tmp_path, old, new)
    monkeypatch.chdir(tmp_path)  # where MuJoCo leaves a log of its warnings
    built = (read_robot, A1Physics, LocomotionController)
    for build in built[2 * (old == CALF) :]:  # its kinematics alone need straight calves
        with pytest.raises(RobotModelError, match=message):
            build(path)
    with pytest.raises(RobotModelError, match=r"nowhere\.xml"):
        read_robot(tmp_path / "nowhere.xml")
