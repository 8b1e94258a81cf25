"""A certificate covers the robot whose files it was earned on, in the scene that began."""

import json
import sys
from pathlib import Path

import pytest

from hcbf_gym import certificates
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


def test_what_no_file_names_makes_no_other_robot(contract):
    before = identity(contract)
    (contract.parent / "wheel.txt").write_text("another one")
    assert identity(contract) == before
