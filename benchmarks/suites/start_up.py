"""What a start costs: processes from nothing to their first filtered step, and installation.

Times are those on the wall. Files are read before the first process counts; pip's downloads come
from its cache, if it has them.
"""

import statistics
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.common import table
from hcbf_gym.evaluation.tables import Table

_ROOT = Path(__file__).parents[2]

_FILTERED = """
import gymnasium as gym, hcbf_gym.wrappers
env = hcbf_gym.wrappers.SafetyFilter(gym.make({name!r}))
env.reset(seed=0)
env.step(env.action_space.sample())
"""
_BATCH = """
import gymnasium as gym, hcbf_gym.wrappers
env = gym.make_vec("HCBF-Regions-v0", num_envs=256, scenario="random")
env = hcbf_gym.wrappers.VectorSafetyFilter(env)
env.reset(seed=0)
env.step(env.action_space.sample())
"""
PROCESSES = {
    "`import hcbf_gym`": "import hcbf_gym",
    "a filtered step of `HCBF-Regions-v0`": _FILTERED.format(name="HCBF-Regions-v0"),
    "of a batch of 256": _BATCH,
    "of `HCBF-A1Regions-v0`": _FILTERED.format(name="HCBF-A1Regions-v0"),
}


def processes(count: int) -> Table:
    """Return the times of new processes, medians of `count` in turn."""
    commands = {what: [sys.executable, "-W", "ignore", "-c", PROCESSES[what]] for what in PROCESSES}
    seconds: dict[str, list[float]] = {what: [] for what in commands}
    for _ in range(1 + count):  # the first round reads the files
        for what, command in commands.items():
            seconds[what].append(_seconds(command))
    return _table("a new process until", {what: some[1:] for what, some in seconds.items()})


def installation(count: int) -> Table:
    """Return the times of installing, medians of `count`; a quick run installs nothing."""
    seconds: dict[str, list[float]] = {}
    for _ in range(count):
        with tempfile.TemporaryDirectory() as folder:
            work = Path(folder)
            for what, step in _steps(work).items():
                seconds.setdefault(what, []).append(step())
    return _table("pip", seconds)


def _steps(work: Path) -> dict[str, Callable[[], float]]:
    """Return what is timed in an empty folder, in the order in which it is possible."""
    venv.create(work / "env", with_pip=True)
    python = str(work / "env" / "bin" / "python")
    constraints = str(_ROOT / "constraints.txt")

    def install_dependencies_and_wheel() -> float:
        wheel = next((work / "wheels").glob("*.whl"))
        return _seconds([python, "-m", "pip", "install", "-q", "-c", constraints, str(wheel)])

    build = [python, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(work / "wheels"), "."]
    return {
        "wheel, the core compiled": lambda: _seconds(build),
        "install it with what it needs": install_dependencies_and_wheel,
    }


def _seconds(command: Sequence[str]) -> float:
    begin = time.perf_counter()
    subprocess.run(command, cwd=_ROOT, check=True, capture_output=True)
    return time.perf_counter() - begin


def _table(what: str, seconds: dict[str, list[float]]) -> Table:
    rows = [
        {"what": name, "median": statistics.median(some), "most": max(some), "n": len(some)}
        for name, some in seconds.items()
    ]
    columns = {
        what: "{what}", "seconds": "{median:.2f}", "slowest": "{most:.2f}", "runs": "{n}"
    }  # fmt: skip
    return table("Seconds of a start", rows, columns)


PARTS = {"processes": (processes, 5, 1), "installation": (installation, 3, 0)}
