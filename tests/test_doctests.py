"""What docstrings show is run as it stands there."""

import doctest
import importlib
import re
from pathlib import Path

import pytest
from needs import imported, needs

import hcbf_gym
from hcbf_gym.sources import PACKAGES

ROOT = Path(hcbf_gym.__file__).parents[1]


def shown(file):
    """Return the lines of a file that a docstring shows as typed."""
    return "\n".join(re.findall(r"^ *>>>.*$", file.read_text(encoding="utf-8"), re.MULTILINE))


SHOWN = sorted(file for top in PACKAGES for file in top.rglob("*.py") if shown(file))


@pytest.mark.parametrize(
    "file",
    [pytest.param(file, marks=needs(*imported(shown(file)))) for file in SHOWN],
    ids=lambda file: str(file.relative_to(ROOT)),
)
def test_the_examples_of_a_docstring_do_what_they_show(file):
    names = file.relative_to(ROOT).with_suffix("").parts
    module = importlib.import_module(".".join(names).removesuffix(".__init__"))
    result = doctest.testmod(module, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert result.attempted > 0
    assert result.failed == 0
