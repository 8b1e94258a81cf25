"""Contracts of walkers: each is checked, and refused clearly where something does not fit."""

import copy
import json
import sys
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hcbf_gym import HcbfError, loading
from hcbf_gym.barriers import BarrierSet
from hcbf_gym.errors import InvalidInputError, RobotModelError, UnknownNameError
from hcbf_robots import Command, Walker, carts
from hcbf_robots.envs.walker_drive import WalkerDrive
from hcbf_robots.envs.walker_physics import WalkerPhysics
from hcbf_robots.walkers.walker_adapter import Adapter

sys.path.insert(0, str(Path(__file__).parent))
from walkers import CARTS, LEARNED, go2, plain

LEGGED = """
<mujoco model="two joints">
  <compiler angle="radian"/>
  <option timestep="0.004"/>
  <worldbody>
    <body name="trunk" pos="0 0 0.1">
      <freejoint/>
      <site name="imu"/>
      <geom type="box" size="0.2 0.2 0.05" mass="5"/>
      <body name="arm" pos="0 0 0.1">
        <joint name="first" axis="0 1 0" range="-1 1" limited="true" damping="1"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.1" mass="0.2" contype="0"/>
        <body name="hand" pos="0 0 0.1">
          <joint name="second" axis="0 1 0" damping="1"/>
          <geom type="sphere" size="0.03" mass="0.1" contype="0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="b" joint="second" kp="5"/>
    <position name="a" joint="first" kp="5" forcerange="-3 3"/>
  </actuator>
  <sensor>
    <gyro name="gyro" site="imu"/>
  </sensor>
</mujoco>
"""

CONTRACT = {
    "name": "two joints",
    "mjcf": "robot.xml",
    "policy": f"{__name__}:still",
    "period": 0.02,
    "observation": [
        {"term": "sensor", "name": "gyro", "scale": 0.25},
        {"term": "gravity", "site": "imu"},
        "linear_velocity",
        "angular_velocity",
        {"term": "joints", "scale": [1.0, 2.0]},
        "rates",
        "last_action",
        "command",
        "phase",
        "state",
        {"term": "contacts", "bodies": ["trunk", "hand"]},
    ],
    "action": {"joints": ["first", "second"], "home": [0.1, -0.2], "scale": [0.5, 0.25]},
    "command": {"forward": 1.0, "sideways": 0.5, "turn": 1.0},
    "body": {"height": 0.051},
    "fall": {"height": 0.02, "tilt": 1.0},
    "phase": {"frequency": 1.5, "start": [0.0, 3.14]},
}
SIZE = 3 + 3 + 3 + 3 + 2 + 2 + 2 + 3 + 4 + (9 + 8) + 2


def still(model, period):
    """Return a controller of two joints that does nothing."""
    return lambda observation: np.zeros(2)


SEEN: list[np.ndarray] = []


def seen(model, period):
    """Return a controller that stores its observations."""
    SEEN.clear()
    return lambda observation: SEEN.append(observation.copy()) or np.array([0.2, -0.4])


def seven(model, period):
    return lambda observation: np.zeros(7)


def turned(model, period):
    """Return a controller whose numbers have an imaginary part."""
    return lambda observation: np.full(2, 1j)


def rude(model, period):
    return lambda observation: 1 / 0


def written(folder, contract):
    """Return a contract's path in a folder that has the robot's file beside it."""
    sys.modules.setdefault(__name__, sys.modules[still.__module__])
    (folder / "robot.xml").write_text(LEGGED, encoding="utf-8")
    path = folder / "contract.json"
    path.write_text(json.dumps(contract), encoding="utf-8")
    return path


def driven(walker, steps=50):
    """Return a walker's drive after so many control steps forward."""
    nothing = BarrierSet([()])
    adapter = Adapter(walker.command, walker.response, 1.0, walker.period)
    drive = WalkerDrive(WalkerPhysics(walker), adapter, None)
    drive.reset(np.zeros(2), 0.3, nothing, np.random.default_rng(0))
    for k in range(steps):
        drive.follow(np.array([0.2, 0.1]), nothing, 0.02 * k)
    return drive


@pytest.mark.parametrize("robot", [*CARTS, *LEARNED])
def test_a_contract_that_fits_is_read_and_walks(robot):
    walker = Walker.load(robot)
    drive = driven(walker)
    assert not drive.failed
    assert not drive.simulation.fallen
    assert np.isfinite(drive.truth).all()
    assert drive.truth[:2] @ np.array([0.2, 0.1]) > 0.005


def test_terms_are_those_of_the_simulation(tmp_path):
    walker = Walker.load(written(tmp_path, CONTRACT | {"policy": f"{__name__}:seen"}))
    drive = driven(walker, 3)
    observation, last = SEEN[1], SEEN[2]
    assert observation.shape == (SIZE,)
    np.testing.assert_array_equal(SEEN[0][16:18], [0.0, 0.0])
    np.testing.assert_array_equal(observation[16:18], [0.2, -0.4])
    np.testing.assert_allclose(np.linalg.norm(observation[3:6]), 1.0)
    np.testing.assert_allclose(SEEN[0][12:14], 0.0, atol=1e-12)  # joints minus home
    data = drive.simulation.data
    np.testing.assert_allclose(data.ctrl[[1, 0]], [0.1 + 0.5 * 0.2, -0.2 - 0.25 * 0.4])
    turn = 2.0 * np.pi * 1.5 * 0.02
    np.testing.assert_allclose(observation[21], np.cos(turn))
    np.testing.assert_allclose(last[23], np.sin(2.0 * turn), atol=1e-12)
    np.testing.assert_allclose(last[12:14], [last[25 + 7] - 0.1, 2.0 * (last[25 + 8] + 0.2)])
    np.testing.assert_array_equal(last[-2:], [1.0, 0.0])


def test_gains_replace_the_files_actuators_and_keep_their_limits(tmp_path):
    action = CONTRACT["action"] | {"gains": {"kp": [20.0, 10.0], "kd": 0.5}}
    walker = Walker.load(written(tmp_path, CONTRACT | {"action": action}))
    model = WalkerPhysics(walker).model
    first, second = model.actuator("first").id, model.actuator("second").id
    np.testing.assert_array_equal(model.actuator_gainprm[[first, second], 0], [20.0, 10.0])
    np.testing.assert_array_equal(model.actuator_biasprm[[first, second], 2], [-0.5, -0.5])
    np.testing.assert_array_equal(model.actuator_forcerange[first], [-3.0, 3.0])
    assert not model.actuator_forcelimited[second]


def changed(**keys):
    contract = copy.deepcopy(CONTRACT)
    for path, value in keys.items():
        *parents, last = path.split("__")
        at = contract
        for parent in parents:
            at = at[parent]
        at[last] = value
    return contract


WRONG = {
    "no such file": (changed(mjcf="nowhere.xml"), RobotModelError, "existing MJCF"),
    "a variable that is not set": (changed(mjcf="$NOT_SET_AT_ALL/r.xml"), RobotModelError, "set"),
    "no such network": (changed(policy="nowhere.onnx"), HcbfError, "policy"),
    "no such module": (changed(policy="no_module:f"), InvalidInputError, "no_module"),
    "no such function": (changed(policy="math:no"), InvalidInputError, "math:no"),
    "a function of another kind": (changed(policy="math:pi"), InvalidInputError, "function"),
    "text for a policy": (changed(policy="walk well"), InvalidInputError, "module:function"),
    "a controller of another size": (changed(policy=f"{__name__}:seven"), InvalidInputError, "2"),
    "a controller of complex numbers": (
        changed(policy=f"{__name__}:turned"),
        InvalidInputError,
        "complex",
    ),
    "a controller that raises": (changed(policy=f"{__name__}:rude"), InvalidInputError, "rude"),
    "no such sensor": (
        changed(observation=[{"term": "sensor", "name": "nose"}]), HcbfError, "gyro"
    ),
    "no such site": (changed(observation=[{"term": "gravity", "site": "nose"}]), HcbfError, "imu"),
    "no such term": (changed(observation=["mood"]), UnknownNameError, "last_action"),
    "a term without its name": (changed(observation=[{"term": "sensor"}]), HcbfError, "'name'"),
    "no such body": (
        changed(observation=[{"term": "contacts", "bodies": ["tail"]}]), HcbfError, "tail"
    ),
    "too many scales": (
        changed(observation=[{"term": "rates", "scale": [1.0, 2.0, 3.0]}]), HcbfError, "scale"
    ),
    "no such joint": (changed(action__joints=["third"]), RobotModelError, "second"),
    "a joint twice": (changed(action__joints=["first", "first"]), InvalidInputError, "once"),
    "another number of homes": (changed(action__home=[0.1]), InvalidInputError, "home"),
    "a home out of range": (changed(action__home=[1.5, 0.0]), InvalidInputError, "-1 to 1"),
    "no such actuator": (
        changed(action={"kind": "direct", "actuators": ["c"]}), RobotModelError, "'a'"
    ),
    "another trunk": (changed(body__trunk="belly"), RobotModelError, "trunk"),
    "a period that the step does not divide": (changed(period=0.01), InvalidInputError, "multiple"),
    "no limits": (changed(command={"forward": 1.0, "turn": 1.0}), InvalidInputError, "look_ahead"),
    "a missing key": (
        {k: v for k, v in CONTRACT.items() if k != "fall"}, InvalidInputError, "'fall'"
    ),
    "an unknown key": (changed(colour="red"), InvalidInputError, "'colour'"),
    "an unknown key of a part": (changed(fall__side="left"), InvalidInputError, "'side'"),
    "nothing for a part": (changed(command=None), InvalidInputError, "command"),
    "a phase without a clock": (
        {k: v for k, v in CONTRACT.items() if k != "phase"}, InvalidInputError, "phase"
    ),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_contract_is_refused_with_what_is_expected(tmp_path, wrong):
    contract, error, names = WRONG[wrong]
    with pytest.raises(error, match=r"expected|raised") as raised:
        Walker.load(written(tmp_path, contract))
    assert names in str(raised.value)


def test_a_file_with_a_floor_or_two_robots_is_refused(tmp_path):
    path = written(tmp_path, CONTRACT)
    robot = tmp_path / "robot.xml"
    floor = '<geom name="ground" type="plane" size="1 1 1"/>'
    robot.write_text(LEGGED.replace("<worldbody>", f"<worldbody>{floor}"), encoding="utf-8")
    with pytest.raises(RobotModelError, match="the robot alone"):
        Walker.load(path)
    robot.write_text(LEGGED.replace("<freejoint/>", ""), encoding="utf-8")
    with pytest.raises(RobotModelError, match="floats"):
        Walker.load(path)
    mesh = '<geom type="mesh" mesh="shell"/><geom type="box"'
    there = LEGGED.replace('<geom type="box"', mesh, 1).replace(
        "<worldbody>", '<asset><mesh name="shell" file="shell.obj"/></asset><worldbody>'
    )
    robot.write_text(there, encoding="utf-8")
    with pytest.raises(RobotModelError, match=r"shell\.obj"):
        Walker.load(path)


@pytest.mark.parametrize("robot", LEARNED)
def test_a_network_of_another_shape_is_refused(tmp_path, robot):
    contract = plain(robot)
    path = tmp_path / "other.json"
    path.write_text(json.dumps(contract | {"observation": contract["observation"][1:]}))
    with pytest.raises(RobotModelError, match="the size of the observation"):
        Walker.load(path)
    action = contract["action"] | {"home": contract["action"]["home"][:11]}
    path.write_text(json.dumps(contract | {"action": action}))
    with pytest.raises(InvalidInputError, match="home"):
        Walker.load(path)


def test_a_missing_extra_is_named_before_work_begins(tmp_path, monkeypatch):
    def missing(what, extra, *modules):
        raise RobotModelError(f"{what}: {extra} {modules}")

    monkeypatch.setattr(loading, "require", missing)
    (tmp_path / "net.onnx").write_bytes(b"")
    with pytest.raises(RobotModelError, match="walkers"):
        Walker.load(written(tmp_path, changed(policy="net.onnx")))


JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 3),
    st.floats(allow_nan=True, allow_infinity=True),
    st.text(max_size=5),
    st.lists(st.one_of(st.integers(-2, 2), st.text(max_size=3), st.floats()), max_size=4),
    st.dictionaries(st.text(max_size=5), st.integers(-2, 2), max_size=2),
    st.sampled_from(["cart.xml", "joints", "direct", "position", "velocity", "first", "command"]),
)


def places(value):
    """Yield the container and the key of every entry of a plain value."""
    for key, item in list(value.items() if isinstance(value, dict) else enumerate(value)):
        yield value, key
        if isinstance(item, dict | list):
            yield from places(item)


def fuzzed(contract, data):
    """Return a contract with a value replaced, removed or added somewhere."""
    contract = copy.deepcopy(contract)
    for _ in range(data.draw(st.integers(1, 2))):
        found = list(places(contract))
        at, key = found[data.draw(st.integers(0, len(found) - 1))]
        how = data.draw(st.sampled_from(["replace", "replace", "remove", "add"]))
        if how == "replace":
            at[key] = data.draw(JUNK)
        elif how == "remove":
            del at[key]
        elif isinstance(at, dict):
            at[data.draw(st.text(max_size=4))] = data.draw(JUNK)
    return contract


def outcome(path):
    """Return "walks", or how the contract is refused."""
    try:
        drive = driven(Walker.load(path), 3)
    except HcbfError as error:
        return str(error)
    return "walks" if np.isfinite(drive.truth).all() else "not finite"


@settings(
    max_examples=500,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(data=st.data())
def test_a_fuzzed_contract_is_refused_clearly_or_walks(tmp_path, data):
    base = data.draw(st.sampled_from([CONTRACT, *map(_cart, CARTS)]))
    path = written(tmp_path, fuzzed(base, data))
    found = outcome(path)
    assert found == "walks" or "expected" in found or "MuJoCo refuses" in found


def _cart(name):
    contract = plain(carts.FOLDER / f"{name}.json")
    return contract | {"mjcf": str(carts.FOLDER / contract["mjcf"])}


@given(
    vx=st.floats(-2.0, 2.0),
    vy=st.floats(-2.0, 2.0),
    yaw=st.floats(-7.0, 7.0),
)
def test_commands_stay_within_the_limits_and_keep_the_direction(vx, vy, yaw):
    for command in (
        Command(forward=1.0, sideways=0.5, turn=1.0),
        Command(forward=1.0, turn=3.0, look_ahead=0.25),
    ):
        given = np.array(Adapter(command, None, 1.0, 0.02).command(vx, vy, yaw, 0.0))
        assert (np.abs(given) <= command.limits + 1e-12).all()
        cos, sin = np.cos(yaw), np.sin(yaw)
        back = np.array([[cos, -sin], [sin, cos]]) @ command.in_plane(given)
        assert abs(back[0] * vy - back[1] * vx) < 1e-9
        assert back @ [vx, vy] >= 0.0


def walked(robot, seconds=3.0):
    """Return the mean velocity of the last second after a ramp to .5 m/s, and whether it fell."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = gym.make("hcbf_robots:HCBF-WalkerRegions-v0", robot=str(robot), scenario="random")
    env.reset(seed=0)
    seen = []
    for k in range(round(seconds / 0.02)):
        _, _, terminated, _, _ = env.step(np.array([1.0, 0.0]) if k < 25 else np.zeros(2))
        seen.append(env.unwrapped.truth[2:])
        if terminated:
            return np.mean(seen, axis=0), True
    return np.mean(seen[-50:], axis=0), False


@pytest.mark.physics
def test_the_go2_of_the_wheel_walks_by_contract(tmp_path):
    path = go2(tmp_path)
    pytest.importorskip("onnxruntime", reason="needs onnxruntime of the extra walkers")
    velocity, fell = walked(path)
    assert not fell
    np.testing.assert_allclose(velocity, [0.5, 0.0], atol=0.15)


def test_the_a1_is_named_with_its_own_environment():
    with pytest.raises(UnknownNameError, match="HCBF-A1Regions-v0"):
        gym.make("hcbf_robots:HCBF-WalkerRegions-v0", robot="a1", scenario="random")
