"""What may be skipped: with `--only-skips`, what a file lists with its reason and nothing else."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

LISTED = "test_some.py::test_listed | no moon tonight"
TESTS = """
import pytest

def test_runs():
    pass

@pytest.mark.skip(reason="no moon tonight")
def test_listed():
    pass
"""
FAILS = "@pytest.mark.xfail(reason='no moon')\ndef test_expected():\n    assert False\n"
OTHERS = {
    "another reason": (LISTED.replace("moon", "sun"), TESTS),
    "another test": (LISTED, TESTS + "\n@pytest.mark.skip(reason='')\ndef test_other(): ...\n"),
    "a whole file": (LISTED, TESTS + "\npytest.importorskip('no_such_module')\n"),
    "what is expected to fail": (LISTED, TESTS + FAILS),
}


def run(folder, listed, tests, *options):
    """Return the exit code of tests under this project's settings, and what was printed."""
    (folder / "conftest.py").write_text(Path(__file__).with_name("conftest.py").read_text("utf-8"))
    (folder / "test_some.py").write_text(tests)
    (folder / "listed").write_text(f"# id | reason\n{listed}\n")
    command = [sys.executable, "-m", "pytest", *options]
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "COV"))}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    return done.returncode, done.stdout


@pytest.mark.parametrize("workers", ["0", "2"])
def test_what_is_listed_may_be_skipped(tmp_path, workers):
    code, printed = run(tmp_path, LISTED, TESTS, "-n", workers, "--only-skips", "listed")
    assert code == pytest.ExitCode.OK, printed
    assert "1 passed, 1 skipped" in printed


@pytest.mark.parametrize(("other", "workers"), list(zip(OTHERS, ["0", "2", "2", "0"], strict=True)))
def test_any_other_skip_fails_the_run_and_is_named(tmp_path, other, workers):
    code, printed = run(tmp_path, *OTHERS[other], "-n", workers, "--only-skips", "listed")
    assert code == pytest.ExitCode.TESTS_FAILED, printed
    assert "not on the list" in printed


def test_what_was_skipped_before_can_be_run_alone(tmp_path):
    (tmp_path / "test_file.py").write_text("import pytest\npytest.importorskip('no_such_module')\n")
    run(tmp_path, "", TESTS, "-n", "2")
    (tmp_path / "test_file.py").write_text("def test_of_a_file():\n    pass\n")
    unskipped = TESTS.replace('@pytest.mark.skip(reason="no moon tonight")', "")
    options = "-n", "2", "--skipped-before", "--only-skips", "listed"
    code, printed = run(tmp_path, "", unskipped, *options)
    assert code == pytest.ExitCode.OK, printed
    assert "2 passed" in printed


def test_without_a_list_anything_may_be_skipped(tmp_path):
    assert run(tmp_path, "", TESTS, "-n", "0")[0] == pytest.ExitCode.OK
