"""The compiled core: made from the sources beside it, headers that anybody can include."""

import ctypes
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import hcbf_gym
from benchmarks import gpu
from hcbf_gym import HcbfError, _core, sources
from hcbf_gym.arrays import record_type
from hcbf_gym.barriers import BrakeClassK, Disc, HalfPlane, LinearClassK, LogClassK
from hcbf_gym.locomotion.state import RobotState
from hcbf_gym.models import Axle, Box

ROOT = Path(__file__).parents[1]
INCLUDE = ROOT / "core" / "include"
README = (ROOT / "core" / "README.md").read_text(encoding="utf-8")
STRICT = ("-std=c++17", "-Wall", "-Wextra", "-Werror", "-fno-exceptions", f"-I{INCLUDE}")


def compiler():
    """Return the C++ compiler of this machine."""
    found = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
    if found is None:
        pytest.skip("needs a C++17 compiler")
    return found


def test_the_module_was_made_from_the_sources_beside_it():
    assert sources.core_hash() == _core.HASH


def test_a_core_that_is_older_than_its_sources_is_refused_with_the_remedy(monkeypatch):
    monkeypatch.setattr(sources, "core_hash", lambda: "another")
    with pytest.raises(ImportError, match="make core"):
        sources.check()


def test_what_lies_elsewhere_than_in_a_checkout_is_not_compared(monkeypatch, tmp_path):
    monkeypatch.setattr(sources, "CORE", tmp_path)
    monkeypatch.setattr(sources, "core_hash", lambda: "another")
    sources.check()


def test_any_edit_of_a_source_changes_the_hash(tmp_path):
    copy = Path(shutil.copytree(ROOT / "core", tmp_path / "core"))
    before = sources.core_hash(copy)
    assert before == _core.HASH
    header = copy / "include" / "hcbf" / "arrays.hpp"
    header.write_text(header.read_text() + "\n")
    edited = sources.core_hash(copy)
    header.rename(header.with_name("views.hpp"))
    assert len({before, edited, sources.core_hash(copy)}) == 3


def test_each_header_stands_alone_without_exceptions_and_warnings(tmp_path):
    headers = sorted(INCLUDE.rglob("*.hpp"))
    assert headers
    unit = tmp_path / "all.cpp"
    names = [header.relative_to(INCLUDE).as_posix() for header in headers]
    for order in (names, names[::-1]):  # what one needs of another, it includes itself
        unit.write_text("".join(f"#include <{name}>\n" for name in order))
        command = [compiler(), *STRICT, "-fsyntax-only", str(unit)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def printed(tmp_path, text, *options):
    """Return the numbers that a C++ program prints, line by line."""
    source, program = tmp_path / "main.cpp", tmp_path / "main"
    source.write_text(text)
    command = [compiler(), *STRICT, *options, str(source), "-o", str(program)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    done = subprocess.run([str(program)], capture_output=True, text=True, check=True)
    return np.array([[float(word) for word in line.split()] for line in done.stdout.splitlines()])


def example():
    """Return the C++ program that core/README.md shows."""
    (block,) = re.findall(r"```cpp\n(.*?)```", README, flags=re.DOTALL)
    return block


def test_the_readmes_cpp_program_filters_as_python_does(tmp_path):
    found = printed(tmp_path, example(), "-O1")
    filt = hcbf_gym.BatchFilter(Box.symmetric(5.0), 0.02)
    disc = Disc("disc", 1, center=(1.5, 0.02), radius=0.5)
    filt.set_scene([disc, HalfPlane("lawn", 2, normal=(1.0, 0.0), offset=1.2)])
    x = np.array([0.0, 0.0, 0.8, 0.0])
    report = filt.reset(x=x)
    assert report["alpha1_scale"] == 1.0  # which the program does not compute
    expected = []
    for _ in range(len(found)):
        u, report = filt(np.array([1.0, 0.0]), x)
        expected.append([*u, report["status"]])
        x = np.array(_core.double_integrator_step(x, u, 0.02, np.inf))
    assert len(set(found[:, 2])) == 3  # relaxed, safe and nominal
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)


def test_a_step_allocates_nothing_after_the_first(tmp_path):
    counts = """#include <cstdlib>
#include <new>

static long allocations = 0;
void* operator new(std::size_t size) { return ++allocations, std::malloc(size); }
void operator delete(void* at) noexcept { std::free(at); }
void operator delete(void* at, std::size_t) noexcept { std::free(at); }
"""
    text = counts + example().replace('"%.17g %.17g %d\\n", u.x, u.y,', '"%ld %d\\n", allocations,')
    found = printed(tmp_path, text, "-O0")
    assert len(set(found[:, 1])) == 3
    assert found[0, 0] > 0
    assert (found[:, 0] == found[0, 0]).all()


def test_a_thread_of_the_gpus_kernel_computes_what_the_core_does(tmp_path):
    library = tmp_path / "filter.so"
    options = *STRICT, "-O1", "-ffp-contract=off", "-fPIC", "-shared", "-x", "c++"
    subprocess.run([compiler(), *options, str(gpu.SOURCE), "-o", str(library)], check=True)
    scenes = gpu.draw(1000)
    found = gpu.empty(scenes)
    places = [array.ctypes.data for array in (*scenes, *found)]
    ctypes.CDLL(str(library)).filter(ctypes.byref(gpu.problem(scenes, places)))
    expected = gpu.on_cpu(scenes)
    assert len(set(expected.status)) == 4  # from nominal to violated
    for one, two in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, two, rtol=0.0, atol=1e-12)


def test_the_core_compiles_for_a_gpu():
    try:
        gpu.toolkit()
    except HcbfError:
        pytest.skip("needs NVRTC: pip install nvidia-cuda-nvrtc nvidia-cuda-cccl")
    assert b".text.filter" in gpu.compiled()


def test_the_readme_names_every_header():
    table, _ = README.split("## Conventions")
    named = set(re.findall(r"`(\w+)`", table))
    assert named == {header.stem for header in INCLUDE.rglob("*.hpp")}


IN_ORDER = {
    "Axle": list(Axle._fields),
    "Geometry": ["x", "y", "side", "ny", "nx", "cos", "sin"],
    "local_guidance.Memory": ["side", "since"],
}


@pytest.mark.parametrize("name", IN_ORDER)
def test_numbers_in_a_row_are_the_fields_of_a_record(name):
    fields = record_type(name).descr
    assert fields == [(field, "<f8") for field in IN_ORDER[name]]


@pytest.mark.parametrize(
    ("alpha", "fields"),
    [
        (LogClassK(2.0, 3.0, 4.0), {"kind": 1.0, "scale": 2.0, "rate": 3.0, "offset": 4.0}),
        (LinearClassK(5.0), {"kind": 0.0, "scale": 5.0}),
        (BrakeClassK(5.0, 0.1), {"kind": 2.0, "scale": 5.0, "offset": 0.1}),
    ],
)
def test_a_class_k_function_has_its_numbers_where_the_core_reads_them(alpha, fields):
    (numbers,) = alpha.parameters().view(record_type("ClassK"))
    assert {name: numbers[name] for name in fields} == fields


def test_a_robots_state_has_its_parts_where_the_core_reads_them():
    dtype = record_type("RobotState")
    state = RobotState(np.arange(dtype.itemsize / 8.0))
    (record,) = state.vector.view(dtype)
    for name in dtype.names[:-1]:
        np.testing.assert_array_equal(record[name].ravel(), getattr(state, name))
    record["contact"] = [1.0, 0.0, 0.0, 1.0]
    assert state.foot_contact.tolist() == [True, False, False, True]
