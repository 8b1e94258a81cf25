"""The Monte Carlo comparison as a user runs it."""

import importlib.util
import json
from pathlib import Path

import pytest

from hcbf_gym.errors import InvalidInputError, UnknownNameError

SCRIPT = Path(__file__).parents[2] / "scripts" / "monte_carlo.py"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("monte_carlo_script", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def arguments(script, folder, **changes):
    settings = {"episodes": 5, "chunk": 2, "policies": ("pd",), "programs": ("r 5", "lex")}
    return script.Args(output=folder, **(settings | changes))


def test_a_broken_run_resumes_and_ends_with_the_same_result(script, tmp_path):
    script.main(arguments(script, tmp_path))
    first = (tmp_path / "summary.json").read_text()
    assert [row["episodes"] for row in json.loads(first)] == [5, 5]
    (tmp_path / "held-pd-lex-2.json").unlink()
    (tmp_path / "summary.json").unlink()
    kept = (tmp_path / "held-pd-lex-0.json").stat().st_mtime_ns
    script.main(arguments(script, tmp_path))
    assert (tmp_path / "summary.json").read_text() == first
    assert (tmp_path / "held-pd-lex-0.json").stat().st_mtime_ns == kept


def test_a_folder_of_another_study_is_left_alone(script, tmp_path):
    script.main(arguments(script, tmp_path, episodes=2, programs=("lex",)))
    before = (tmp_path / "summary.json").read_text()
    with pytest.raises(InvalidInputError, match="seed"):
        script.main(arguments(script, tmp_path, seed=1))
    assert (tmp_path / "summary.json").read_text() == before


def test_senseless_arguments_are_refused(script, tmp_path):
    with pytest.raises(UnknownNameError, match="lex"):
        script.main(arguments(script, tmp_path, programs=("hope",)))
    with pytest.raises(InvalidInputError, match="episodes"):
        script.main(arguments(script, tmp_path, episodes=0))
