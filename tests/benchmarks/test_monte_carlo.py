"""The Monte Carlo comparison as a user runs it."""

import json

import pytest

from benchmarks.suites import monte_carlo as command
from hcbf_gym.errors import InvalidInputError, UnknownNameError


def arguments(folder, **changes):
    few = {"episodes": 5, "chunk": 2, "policies": ("pd",), "programs": ("r 5", "lex"), "workers": 1}
    return command.Args(output=folder, **(few | changes))


def test_a_broken_run_resumes_and_ends_with_the_same_result(tmp_path):
    command.main(arguments(tmp_path))
    first = (tmp_path / "summary.json").read_text()
    assert [row["episodes"] for row in json.loads(first)] == [5, 5]
    lost, *kept = (tmp_path / "chunks").iterdir()
    stamps = {path: path.stat().st_mtime_ns for path in kept}
    assert len(kept) == 5
    lost.unlink()
    (tmp_path / "summary.json").unlink()
    command.main(arguments(tmp_path))
    assert (tmp_path / "summary.json").read_text() == first
    assert stamps == {path: path.stat().st_mtime_ns for path in kept}


def test_a_folder_of_another_study_is_left_alone(tmp_path):
    command.main(arguments(tmp_path, episodes=2, programs=("lex",)))
    before = (tmp_path / "summary.json").read_text()
    with pytest.raises(InvalidInputError, match="seed"):
        command.main(arguments(tmp_path, seed=1))
    assert (tmp_path / "summary.json").read_text() == before


def test_senseless_arguments_are_refused(tmp_path):
    with pytest.raises(UnknownNameError, match="lex"):
        command.main(arguments(tmp_path, programs=("hope",)))
    with pytest.raises(InvalidInputError, match="episodes"):
        command.main(arguments(tmp_path, episodes=0))
