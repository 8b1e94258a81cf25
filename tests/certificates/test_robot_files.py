"""A certificate covers the robot whose files it was earned on, in the scene that began."""

import json
import re
import sys
from pathlib import Path

import gymnasium as gym
import pytest

from hcbf_gym import certificates
from hcbf_gym.errors import CoverageWarning
from hcbf_gym.robots import a1
from hcbf_robots import Walker, carts

CARTS = Path(carts.__file__).parent
INCLUDED = "<mujocoinclude><option timestep='0.002'/></mujocoinclude>"
POLICY = """
from gains import GAIN
from hcbf_robots.carts import differential


def drives(*arguments, **options):
    return differential(*arguments, **options)
"""


@pytest.fixture
def contract(tmp_path, monkeypatch):
    """A cart whose MJCF includes a file of a folder, and whose policy imports a neighbour."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "option.xml").write_text(INCLUDED)
    (tmp_path / "wheel.txt").write_text("no mesh")
    xml = (CARTS / "cart.xml").read_text()
    head, sep, rest = xml.partition(">")
    (tmp_path / "cart.xml").write_text(f'{head}{sep}<include file="parts/option.xml"/>{rest}')
    (tmp_path / "own_policy.py").write_text(POLICY)
    (tmp_path / "gains.py").write_text("GAIN = 1.0\n")
    data = json.loads((CARTS / "cart.json").read_text()) | {"policy": "own_policy:drives"}
    (tmp_path / "cart.json").write_text(json.dumps(data))
    response = (CARTS / "cart.response.json").read_text()
    (tmp_path / "cart.response.json").write_text(response)
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in ("own_policy", "gains"):
        sys.modules.pop(name, None)
    yield tmp_path / "cart.json"
    for name in ("own_policy", "gains"):
        sys.modules.pop(name, None)


def identity(contract):
    walker = Walker.load(contract)
    return certificates.robot_of(walker.name, walker.files)


@pytest.mark.parametrize(
    "file",
    [
        "cart.json",
        "cart.xml",
        "cart.response.json",
        "parts/option.xml",
        "own_policy.py",
        "gains.py",
    ],
)
def test_a_file_that_is_changed_makes_another_robot(contract, file):
    before = identity(contract)
    path = contract.parent / file
    text = path.read_text()
    path.write_text(text.replace("0.002", "0.001") if "option" in file else text + "\n")
    assert identity(contract) != before
    path.write_text(text)
    assert identity(contract) == before


HULL = """v 0 0 0
v 0.1 0 0
v 0 0.1 0
v 0 0 0.1
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


def test_a_mesh_that_is_changed_makes_another_robot_with_the_a1s_joints(tmp_path):
    (tmp_path / "meshes").mkdir()
    mesh = tmp_path / "meshes" / "hull.obj"
    text = a1.XML_FILE.read_text(encoding="utf-8")
    head, trunk, rest = re.split(r'(<body name="trunk"[^>]*>)', text)
    assets = '<asset><mesh name="hull" file="hull.obj"/></asset>'
    hull = '<geom name="hull" type="mesh" mesh="hull" mass="0.1"/>'
    xml = re.sub(r"<mujoco[^>]*>", rf'\g<0><compiler meshdir="meshes"/>{assets}', head)
    (tmp_path / "hull.xml").write_text(f"{xml}{trunk}{hull}{rest}", encoding="utf-8")

    def declared():
        with pytest.warns(CoverageWarning, match="xml_file"):
            env = gym.make("HCBF-A1Regions-v0", xml_file=str(tmp_path / "hull.xml"))
        return env.unwrapped.declared["xml_file"]

    mesh.write_text(HULL)
    before = declared()
    mesh.write_text(HULL.replace("v 0 0 0.1", "v 0 0 0.2"))
    assert declared() != before
    mesh.write_text(HULL)
    assert declared() == before


def test_what_no_file_names_makes_no_other_robot(contract):
    before = identity(contract)
    (contract.parent / "wheel.txt").write_text("another one")
    assert identity(contract) == before
