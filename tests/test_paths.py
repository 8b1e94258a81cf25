"""How much a newcomer reads to follow one step: files and functions, which `pytest -s` prints.

Python's functions are counted by a trace, the core's by gcov, as the calls that the last step adds.
What is nested in a function, such as a lambda, counts with it, and so do the instances of a
template. Views and algebra of arrays are left out (`ARRAYS`), as NumPy's own functions are.
"""

import contextlib
import importlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = tuple(str(ROOT / name) + os.sep for name in ("hcbf_gym", "hcbf_robots", "hcbf_lab"))
ARRAYS = {"arrays.hpp", "matrices.hpp", "bindings.hpp", "records.hpp"}
MOST = {
    "u* to u": {"Python": (7, 11), "core": (12, 84)},
    "NaN to brake": {"Python": (7, 12), "core": (5, 20)},
    "u to torque": {"Python": (1, 1), "core": (12, 44)},
}
"""Of each path so many files and functions."""


class ReachedError(Exception):
    """The end of a path."""


class End(gym.Wrapper):
    """An environment at whose step a path may end."""

    is_end = False

    def step(self, action):
        if self.is_end:
            raise ReachedError
        return super().step(action)


def filtered(unknown):
    """Return the last step of a filtered episode, whose state may be unknown."""
    import hcbf_gym

    env = End(gym.make("HCBF-Regions-v0"))
    plant = env.unwrapped.plant
    seen = {"x": None}

    def state(env, observation, info):
        estimate = plant.state(env, observation, info)
        return estimate if seen["x"] is None else estimate._replace(x=seen["x"])

    own = {"plant": replace(plant, state=state)} if unknown else {}
    env = hcbf_gym.wrappers.SafetyFilter(env, **own)
    policy = hcbf_gym.policies.PDTracker.for_env(env)
    observation, info = env.reset(seed=0)
    for k in range(50):
        if unknown and k == 49:
            seen["x"] = np.full(4, np.nan)  # it is warned of once
        observation, *_, info = env.step(policy(observation, info))
    action = policy(observation, info)
    env.env.is_end = True
    return lambda: env.step(action)


def steered():
    """Return the controller's next step of a walking A1, from its state and u to torques."""
    env = gym.make("HCBF-A1Regions-v0").unwrapped
    env.reset(seed=0)
    u = np.array([0.3, 0.1])
    for _ in range(10):
        env.step(u.astype(np.float32))
    state, controller = env.drive.simulation.state(None), env.controller
    return lambda: controller.step(state, u)


STEPS = {
    "u* to u": lambda: filtered(unknown=False),
    "NaN to brake": lambda: filtered(unknown=True),
    "u to torque": steered,
}


def python_functions(last):
    """Return the functions of the packages that a step calls, as (file, name)."""
    found = {}

    def note(frame, event, _):
        file = frame.f_code.co_filename
        if event == "call" and file.startswith(PACKAGES):
            name = frame.f_code.co_qualname.partition(".<locals>")[0]
            found[str(Path(file).relative_to(ROOT)), name] = None

    sys.setprofile(note)
    try:
        with contextlib.suppress(ReachedError):
            last()
    finally:
        sys.setprofile(None)
    return list(found)


@pytest.fixture(scope="module")
def counting_core(tmp_path_factory):
    """Return the folder of a core that counts calls."""
    if shutil.which("gcov") is None or shutil.which("cmake") is None:
        pytest.skip("needs gcov and cmake: apt-get install gcc cmake")
    if importlib.util.find_spec("nanobind") is None:
        pytest.skip("needs nanobind of the extra core: pip install -e '.[core]'")
    folder = tmp_path_factory.mktemp("core")
    flags = "-DCMAKE_BUILD_TYPE=None", "-DHCBF_COUNT=ON", f"-DPython_EXECUTABLE={sys.executable}"
    quiet = {"check": True, "stdout": subprocess.DEVNULL}
    subprocess.run(["cmake", "-S", ROOT / "core", "-B", folder, *flags], **quiet)
    subprocess.run(["cmake", "--build", folder, "--parallel", "--target", "_core"], **quiet)
    return folder


def core_functions(folder, path):
    """Return the functions of the core that the last step of a path calls: (file, line, name)."""
    before, after = (calls(folder, path, last) for last in ("", "last"))
    return sorted(key for key, count in after.items() if count != before[key])


def calls(folder, path, last):
    """Return how often each function of the core was called in an episode."""
    for file in folder.rglob("*.gcda"):
        file.unlink()
    command = [sys.executable, "-W", "ignore", __file__, str(folder), path, last]
    subprocess.run(command, check=True, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)})
    counts = Counter()
    for file in folder.rglob("*.gcda"):
        gcov = ["gcov", "--json-format", "--stdout", "--object-directory", file.parent, file]
        found = subprocess.run(gcov, check=True, capture_output=True, cwd=ROOT / "core").stdout
        for source in json.loads(found)["files"]:
            name = (ROOT / "core" / source["file"]).resolve()
            if ROOT / "core" not in name.parents or name.name in ARRAYS:
                continue
            for one in source["functions"]:
                if "{lambda" not in one["demangled_name"]:
                    key = str(name.relative_to(ROOT)), one["start_line"], plain(one)
                    counts[key] += one["execution_count"]
    return counts


def plain(function):
    """Return a function's name without namespaces, arguments and instances of templates."""
    name = function["demangled_name"].replace("(anonymous namespace)::", "").partition("(")[0]
    while "<" in name.partition("operator")[0]:
        name = re.sub(r"<[^<>]*>", "", name)
    return name.rpartition("::")[2].rpartition(" ")[2]


def show(path, language, functions):
    """Print a path, and return how many files and functions it has."""
    by_file = {}
    for file, *_, name in functions:
        by_file.setdefault(file, []).append(name)
    size = len(by_file), len(functions)
    print(f"\n{path}, {language}: {size[0]} files, {size[1]} functions")
    for file, names in by_file.items():
        print(f"  {file}: {', '.join(names)}")
    return size


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("path", MOST)
def test_path_of_a_step_is_short_in_python(path):
    files, functions = show(path, "Python", python_functions(STEPS[path]()))
    assert files <= MOST[path]["Python"][0]
    assert functions <= MOST[path]["Python"][1]


def test_paths_of_a_step_are_short_in_the_core(counting_core):
    for path, most in MOST.items():
        found = core_functions(counting_core, path)
        files, functions = show(path, "core", found)
        if path == "NaN to brake":
            beyond = {"rows.hpp", "cascade.hpp", "conclusion.hpp", "monitor.hpp", "margins.hpp"}
            assert not beyond & {Path(file).name for file, *_ in found}
        assert files <= most["core"][0], path
        assert functions <= most["core"][1], path


def run(folder, path, last):
    """Run an episode with a core that counts calls, and its last step where that is asked."""
    (file,) = Path(folder).glob("_core*.so")
    spec = importlib.util.spec_from_file_location("hcbf_gym._core", file)
    sys.modules["hcbf_gym._core"] = core = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(core)
    importlib.import_module("hcbf_gym")  # registers its environments
    step = STEPS[path]()
    if last:
        with contextlib.suppress(ReachedError):
            step()


if __name__ == "__main__":
    run(*sys.argv[1:])
