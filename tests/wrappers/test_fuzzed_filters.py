"""Any values: no raw error, no crash, and nothing unknown passes."""

import os
import subprocess
import sys
from pathlib import Path

COUNT = int(os.environ.get("HCBF_FUZZ_VALUES", "400"))


def test_fuzzed_values_are_refused_or_braked_and_never_crash():
    root = Path(__file__).parents[2]
    command = [sys.executable, "-m", "tests.wrappers.fuzz", str(COUNT)]
    ended = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout[-2000:] + ended.stderr[-4000:]
    assert "braked" in ended.stdout
    assert "refused" in ended.stdout
