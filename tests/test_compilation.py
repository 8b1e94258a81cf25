"""Compiled kernels are those of the present sources, and the first use says what takes so long."""

import contextlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import hcbf_gym
from hcbf_gym.compilation import CacheFile, Stamp

PACKAGE = Path(hcbf_gym.__file__).parent
USE = "import hcbf_gym; from hcbf_gym import outer; print(outer.caller(1.0))"


def make_package(folder):
    """A package of the same name whose kernel calls another file's, which reads a third's."""
    package = folder / "hcbf_gym"
    package.mkdir()
    shutil.copy(PACKAGE / "compilation.py", package)
    (package / "__init__.py").write_text(
        "from hcbf_gym import compilation\ncompilation.prepare()\n"
    )
    (package / "constants.py").write_text("GAIN = 2.0\n")
    for name, imports, line in (
        ("inner", "from hcbf_gym.constants import GAIN", "def callee(x):\n    return GAIN * x\n"),
        (
            "outer",
            "from hcbf_gym import inner",
            "def caller(x):\n    return inner.callee(x) + 1.0\n",
        ),
    ):
        text = f"from hcbf_gym.compilation import kernel\n{imports}\n@kernel()\n{line}"
        (package / f"{name}.py").write_text(text)
    return package


def run(folder, **environment):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", USE],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout), "compiling" in done.stderr


def test_an_edited_kernel_that_another_file_calls_is_recompiled(tmp_path):
    package = make_package(tmp_path)
    assert run(tmp_path) == (3.0, True)
    assert run(tmp_path) == (3.0, False)  # from the cache, without a word
    (package / "inner.py").write_text((package / "inner.py").read_text().replace("* x", "- x"))
    assert run(tmp_path) == (2.0, True)
    (package / "constants.py").write_text("GAIN = 5.0\n")
    assert run(tmp_path) == (5.0, True)


def test_the_users_own_cache_folder_is_kept_and_kernels_run_uncompiled(tmp_path):
    package = make_package(tmp_path)
    cache = tmp_path / "cache"
    assert run(tmp_path, NUMBA_CACHE_DIR=str(cache)) == (3.0, True)
    assert list(cache.rglob("*.nbi"))
    assert not list(package.rglob("*.nbi"))
    assert run(tmp_path, NUMBA_DISABLE_JIT="1") == (3.0, False)


def test_no_process_finds_a_kernel_of_other_sources_while_another_one_writes(tmp_path, monkeypatch):
    old, new = (
        CacheFile(str(tmp_path), "file.kernel-1", Stamp((1.0, 10), sources))
        for sources in ("old", "new")
    )
    old.save("float64", "old kernel")
    found = []
    write = CacheFile._open_for_write

    @contextlib.contextmanager
    def watched(self, path):
        found.append(new.load("float64"))
        with write(self, path) as file:
            yield file
        found.append(new.load("float64"))

    monkeypatch.setattr(CacheFile, "_open_for_write", watched)
    new.save("float64", "new kernel")
    assert found == [None, None, None, "new kernel"]  # the kernel is written, then the index
    assert old.load("float64") is None
    assert len(list(tmp_path.glob("*.nbc"))) == 1


def test_signatures_that_two_processes_compile_at_once_are_not_mixed_up(tmp_path, monkeypatch):
    one, other = (CacheFile(str(tmp_path), "kernel", Stamp((), "sources")) for _ in range(2))
    other.save("float32", "short")
    monkeypatch.setattr(one, "_load_index", dict)  # as it was before the other one had written
    one.save("float64", "long")
    reader = CacheFile(str(tmp_path), "kernel", Stamp((), "sources"))
    assert reader.load("float64") == "long"
    assert reader.load("float32") in (None, "short")
    other.save("float32", "short")
    assert (reader.load("float64"), reader.load("float32")) == ("long", "short")


EPISODE = """
import gymnasium as gym, numpy as np
from hcbf_gym.wrappers import SafetyFilter

env = SafetyFilter(gym.make("HCBF-Regions-v0", scenario="random"), guidance="geodesic")
observation, _ = env.reset(seed=1)
rng = np.random.default_rng(0)
for _ in range(30):
    action = rng.uniform(-3.0, 3.0, 2).astype(np.float32)
    observation, reward, *_, info = env.step(action)
    u = info["safety_filter"]["u_safe"]
    print(observation.tobytes().hex(), reward.hex(), u.tobytes().hex())
"""


def test_the_first_episode_from_an_empty_cache_is_the_second_bit_for_bit(tmp_path):
    said = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", EPISODE],
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        said.append((done.stdout, "compiling" in done.stderr))
    (first, compiled), (second, again) = said
    assert first.count("\n") == 30
    assert first == second
    assert (compiled, again) == (True, False)


def test_a_kernel_is_called_by_a_users_own_function_and_by_python(tmp_path):
    make_package(tmp_path)
    (tmp_path / "own.py").write_text(
        "from numba import njit\n"
        "from hcbf_gym import inner, outer\n"
        "@njit(cache=True)\n"
        "def both(x):\n"
        "    return outer.caller(x) - inner.callee(x)\n"
        "print(both(1.0) + inner.callee(1.0))\n"
    )
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-W", "error", "own.py"],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        assert float(done.stdout) == 3.0


OTHERS = """
import numpy as np
from numba import njit
from hcbf_gym import outer

@njit
def copied(to, of):
    to[:] = of

@njit(inline="always")
def twice(x):
    return 2.0 * x

@njit
def both(x, y):
    return twice(x) if y is None else twice(x) + twice(y)

made = {"njit": njit}
exec("@njit(inline='always')\\ndef half(x):\\n    return 0.5 * x", made)  # of no module
half = made["half"]

@njit
def quarter(x):
    return half(half(x))

before = outer.caller(1.0)
try:
    copied(np.zeros(2), np.zeros(3))
except ValueError as error:
    print(error)
print(both(1.0, None), both(1.0, 2.0), quarter(1.0))
"""


def test_what_others_compile_in_the_same_process_is_as_numba_makes_it(tmp_path):
    make_package(tmp_path)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", OTHERS],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    says, values = done.stdout.splitlines()
    assert "(3,)" in says  # the shapes, which this package's own kernels do without
    assert "(2,)" in says
    assert values == "2.0 6.0 0.25"


BRANCHES = """
import numpy as np
from hcbf_gym.compilation import kernel

@kernel(inline="always")
def first(x):
    return x[0]

@kernel()
def chosen(x, given):
    if given is None:
        return first(x)
    total = first(x)
    for k in range(3):
        total += k if given else -k
    return total + first(x)

x = np.arange(1.0, 4.0)
print([float(chosen(x, given)) for given in (None, True, False, None)])
"""


def test_a_branch_counts_where_an_argument_is_given_and_where_it_is_not(tmp_path):
    package = make_package(tmp_path)
    (package / "chosen.py").write_text(BRANCHES)
    for switched_off in ("0", "1"):
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", "from hcbf_gym import chosen"],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_DISABLE_JIT": switched_off},
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.strip() == "[1.0, 5.0, -1.0, 1.0]"
