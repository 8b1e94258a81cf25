"""What the count of the package counts."""

import pytest

from benchmarks import house
from hcbf_gym.errors import InvalidInputError

CODE = '''"""Two lines
of docstring."""

from typing import Any  # a comment counts for nothing

import numpy


def short(self, a, b, c, d, e, f, g, h):
    """Say nothing."""
    x, y = 1, 2
    z = x
    text = """two
    lines"""


def many(a, b, c, d, e, f, g, h, i) -> Any: ...
'''


@pytest.fixture
def checkout(tmp_path):
    (tmp_path / "hcbf_lab").mkdir()
    (tmp_path / "hcbf_lab/code.py").write_text(CODE)
    (tmp_path / "README.md").write_text("# Three words\nand three more\n")
    return tmp_path


def test_each_figure_is_that_of_the_packages(checkout):
    counted = house.count(checkout)
    assert counted["files"] == "1"
    assert counted["lines"] == str(len(CODE.splitlines()))
    assert counted["lines of code"] == "8"
    assert counted["functions"] == "2"
    assert counted["longest function"] == "6 lines, short"
    assert counted["median function"] == "3.5 lines"
    assert counted["functions over 8 parameters"] == "1"
    assert counted["several-part assignments"] == "1 of 3, 33.3%"
    assert counted["Any"] == "2"
    assert counted["imported from outside"] == "1: numpy"
    assert counted["words of README"] == "6"


def test_circles_arrows_upwards_and_aliases_are_counted(checkout):
    package = checkout / "hcbf_gym"
    for name, text in {
        "low/one.py": "from hcbf_gym.low.two import g",
        "low/two.py": "def f():\n    from hcbf_gym.low import one",
        "low/three.py": "from hcbf_gym.low import two\nNumbers = NDArray[np.float64]",
        "low/__init__.py": "from hcbf_gym.low.one import f",
        "high/four.py": "from hcbf_gym.low.three import Numbers",
        "low/five.py": "if TYPE_CHECKING:\n    from hcbf_gym.high.four import g",
    }.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(text + "\n")
    (checkout / "tests").mkdir()
    (checkout / "tests" / "test.py").write_text("a = 1\nb = 2\n")
    contract = '[[tool.importlinter.contracts]]\ntype = "layers"\nlayers = ["high", "low"]\n'
    (checkout / "pyproject.toml").write_text(contract)
    counted = house.count(checkout)
    assert counted["circles of imports"] == "1"
    assert counted["imports upwards"] == "1"
    assert counted["aliases of arrays elsewhere"] == "1"
    assert (counted["lines of tests"], counted["lines of benchmarks"]) == ("2", "0")


def test_what_is_no_checkout_and_what_is_no_revision_is_refused(tmp_path):
    with pytest.raises(InvalidInputError, match="checkout"):
        house.count(tmp_path)
    with pytest.raises(InvalidInputError, match="no-such-revision"):
        house.main(against="no-such-revision")


def test_a_line_that_has_moved_is_not_deleted(checkout, tmp_path):
    now = tmp_path / "now"
    (now / "benchmarks").mkdir(parents=True)
    kept = CODE.splitlines()
    lost = next(line for line in kept if line.strip() and kept.count(line) == 1)
    kept.remove(lost)
    (now / "benchmarks" / "moved.py").write_text("\n".join(f"    {line}" for line in kept))
    total = len([line for line in CODE.splitlines() if line.strip()])
    assert house.deleted(checkout, now) == f"1 of {total}"
