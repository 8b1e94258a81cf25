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
_WITHOUT_RUNTIME = "needs onnxruntime of the extra walkers: pip install 'hcbf-gym[walkers]'"


def learned(name):
    """Return a contract of a learned walker as a parameter, skipped where it cannot run."""
    there = (Path(DATA) / "walkers" / name).is_dir() if DATA else False
    runs = importlib.util.find_spec("onnxruntime") is not None
    marks = [
        pytest.mark.skipif(not there, reason=_WITHOUT_DATA),
        pytest.mark.skipif(not runs, reason=_WITHOUT_RUNTIME),
    ]
    return pytest.param(str(CONTRACTS / f"{name}.json"), marks=marks, id=name)


LEARNED = (learned("go1"), learned("berkeley_humanoid"))


def plain(path):
    """Return a contract as the plain dict that its file holds."""
    return json.loads(Path(path).read_text(encoding="utf-8"))
