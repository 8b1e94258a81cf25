"""Filter 65,536 states of 12 conditions on a GPU, and compare with the core.

`pip install nvidia-cuda-nvrtc nvidia-cuda-cccl`, then `python -m benchmarks.gpu`: it compiles
`core/cuda/filter.cu`, a thread a state, runs it, and prints its time and the largest difference.
"""

import ctypes
import importlib.util
import statistics
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hcbf_gym import _core
from hcbf_gym.arrays import Array, Integers
from hcbf_gym.barriers import Disc, HalfPlane, layout
from hcbf_gym.barriers.rows import ALPHA2_PSI, B, CbfRows, H, RowSettings
from hcbf_gym.errors import HcbfError
from hcbf_gym.models.input_sets import Box
from hcbf_gym.programs import make_batch

CORE = Path(__file__).parents[1] / "core"
SOURCE = CORE / "cuda" / "filter.cu"
U = Box.symmetric(5.0)
RADIUS = float(U.radius)
SETTINGS = RowSettings(period=0.02, u_max=RADIUS, limits=((-5.0, -5.0), (5.0, 5.0)))
STANDARD = ("algorithm", "array", "cmath", "cstddef", "cstdint", "cstdlib", "cstring", "limits",
            "optional", "utility", "vector")  # fmt: skip
LIBRARIES = "libnvrtc-builtins", "libnvrtc"  # the second looks for the first
THREADS, RUNS = 32, 21  # of a block, and whose median counts


class Scenes(NamedTuple):
    """N states and their conditions, in the order of the kernel's record."""

    u_nominal: Array  # (N, 2)
    x: Array  # (N, 4)
    t: Array  # (N,)
    parameters: Array  # (N, m, WIDTH)
    kind: Integers  # (N, m)
    priority: Integers  # (N, m)


class Answer(NamedTuple):
    """What is written of N states."""

    u: Array  # (N, 2)
    slack: Array  # (N, m)
    h: Array  # (N, m)
    status: Integers  # (N,)


class Problem(ctypes.Structure):
    """The kernel's record."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("count", "m")),
        ("settings", ctypes.c_double * 19),
        ("corners", ctypes.c_double * 8),
        *((name, ctypes.c_void_p) for name in (*Scenes._fields, *Answer._fields)),
    ]


def problem(scenes: Scenes, places: list[int]) -> Problem:
    """Return the kernel's record of scenes and answers that are at these addresses."""
    settings, corners = SETTINGS.packed.tolist(), U.vertices().ravel().tolist()
    numbers = (ctypes.c_double * 19)(*settings), (ctypes.c_double * 8)(*corners)
    return Problem(*scenes.kind.shape, *numbers, *places)


def draw(count: int, discs: int = 8, walls: int = 3) -> Scenes:
    """Return random states among discs, half of which move, walls, and a speed limit of rank 1."""
    rng, m = np.random.default_rng(0), discs + walls + 1
    codes = [Disc.code] * discs + [HalfPlane.code] * walls + [layout.SPEED_LIMIT]
    c = np.zeros((count, m, layout.WIDTH))
    moves = rng.random((count, discs, 1)) < 0.5
    c[:, :discs, :2] = rng.uniform(-0.4, 0.4, (count, discs, 2)) * moves  # their velocity
    c[:, :discs, 2:4] = rng.uniform(-3.5, 3.5, (count, discs, 2))
    c[:, :discs, 4] = rng.uniform(0.2, 0.9, (count, discs))
    angle = rng.uniform(0.0, 2.0 * np.pi, (count, walls))
    c[:, discs:-1, 2], c[:, discs:-1, 3] = np.cos(angle), np.sin(angle)
    c[:, discs:-1, 4] = rng.uniform(-3.5, -1.0, (count, walls))
    c[:, -1, layout.V_MAX] = 1.0
    priority = rng.integers(1, 4, (count, m))
    priority[:, :3], priority[:, -1] = (1, 2, 3), 1  # no rank is left out
    x = np.concatenate((rng.uniform(-3, 3, (count, 2)), rng.uniform(-1, 1, (count, 2))), axis=1)
    u_nominal, t = rng.uniform(-6.0, 6.0, (count, 2)), rng.uniform(0.0, 1.0, count)
    return Scenes(
        u_nominal, x, t, c, np.tile(np.array(codes, dtype=np.int64), (count, 1)), priority
    )


def empty(scenes: Scenes) -> Answer:
    """Return room for an answer."""
    count, m = scenes.kind.shape
    slack, h = np.empty((2, count, m))
    return Answer(np.empty((count, 2)), slack, h, np.empty(count, dtype=np.int64))


def on_cpu(scenes: Scenes) -> Answer:
    """Return the core's answer."""
    shape = scenes.kind.shape
    a, out = np.empty((*shape, 2)), np.empty((4, *shape))
    margin = np.zeros((3, *shape))
    _core.planar_rows(
        scenes.kind, scenes.parameters, margin, scenes.x, scenes.t, SETTINGS.packed, a, out
    )
    rows = CbfRows(a, out[B], out[H], scenes.priority, out[ALPHA2_PSI])
    found = make_batch("lex-cbf-qp", input_set=U)(scenes.u_nominal, rows)
    return Answer(found.u, found.slack, out[H], found.status)


def toolkit() -> Path:
    """Return the folder of NVRTC and libcu++."""
    found = importlib.util.find_spec("nvidia")
    for folder in found.submodule_search_locations or () if found else ():
        if list(Path(folder).glob("cu13/lib/libnvrtc.so*")):
            return Path(folder) / "cu13"
    raise HcbfError("NVRTC: got none, expected: pip install nvidia-cuda-nvrtc nvidia-cuda-cccl")


def compiled(target: str = "sm_80") -> bytes:
    """Return the kernel's machine code for a target."""
    folder = toolkit()
    libraries = [ctypes.CDLL(str(next(folder.glob(f"lib/{name}.so*")))) for name in LIBRARIES]
    nvrtc = libraries[-1]
    names = ctypes.c_char_p * len(STANDARD)
    made, size = ctypes.c_void_p(), ctypes.c_size_t()
    nvrtc.nvrtcCreateProgram(
        ctypes.byref(made), SOURCE.read_bytes(), b"filter.cu", len(STANDARD),
        names(*[b"//"] * len(STANDARD)), names(*(name.encode() for name in STANDARD)),
    )  # fmt: skip
    include = [f"-I{CORE / 'include'}", f"-I{folder / 'include/cccl'}", f"-I{folder / 'include'}"]
    options = ["-default-device", "-std=c++17", f"-arch={target}", "-fmad=false", *include]
    given = (ctypes.c_char_p * len(options))(*(option.encode() for option in options))
    failed = nvrtc.nvrtcCompileProgram(made, len(options), given)
    part = "ProgramLog" if failed else "CUBIN"
    getattr(nvrtc, f"nvrtcGet{part}Size")(made, ctypes.byref(size))
    text = ctypes.create_string_buffer(size.value)
    getattr(nvrtc, f"nvrtcGet{part}")(made, text)
    if failed:
        raise HcbfError(f"NVRTC: {text.value.decode()}")
    return text.raw


def on_gpu(scenes: Scenes) -> tuple[Answer, float]:
    """Return the kernel's answer, and the median time that it takes [s]."""
    cuda, answer = ctypes.CDLL("libcuda.so.1"), empty(scenes)

    def call(name: str, *arguments: Any) -> None:
        if code := getattr(cuda, name)(*arguments):
            raise HcbfError(f"{name}: got error {code}, expected 0")

    def copy(name: str, one: Any, other: Any, size: int) -> None:
        call(name, one, other, ctypes.c_size_t(size))

    context, module, kernel = (ctypes.c_void_p() for _ in range(3))
    major, minor = ctypes.c_int(), ctypes.c_int()
    call("cuInit", 0)
    call("cuDeviceGetAttribute", ctypes.byref(major), 75, 0)  # the compute capability
    call("cuDeviceGetAttribute", ctypes.byref(minor), 76, 0)
    call("cuDevicePrimaryCtxRetain", ctypes.byref(context), 0)
    call("cuCtxSetCurrent", context)
    call("cuModuleLoadData", ctypes.byref(module), compiled(f"sm_{major.value}{minor.value}"))
    call("cuModuleGetFunction", ctypes.byref(kernel), module, b"filter")
    arrays = [np.ascontiguousarray(array) for array in (*scenes, *answer)]
    places = [ctypes.c_uint64() for _ in arrays]
    for place, array in zip(places, arrays, strict=True):
        call("cuMemAlloc_v2", ctypes.byref(place), ctypes.c_size_t(array.nbytes))
        copy("cuMemcpyHtoD_v2", place, ctypes.c_void_p(array.ctypes.data), array.nbytes)
    given = problem(scenes, [place.value for place in places])
    arguments = (ctypes.c_void_p * 1)(ctypes.addressof(given))
    blocks, times = -(-len(scenes.x) // THREADS), []
    for _ in range(RUNS):
        start = time.perf_counter()
        call("cuLaunchKernel", kernel, blocks, 1, 1, THREADS, 1, 1, 0, None, arguments, None)
        call("cuCtxSynchronize")
        times.append(time.perf_counter() - start)
    for place, array in zip(places[-4:], answer, strict=True):
        copy("cuMemcpyDtoH_v2", ctypes.c_void_p(array.ctypes.data), place, array.nbytes)
    return answer, statistics.median(times)


def main() -> None:
    """Print the kernel's time, and how far its answers are from the core's."""
    scenes = draw(65_536)
    expected = on_cpu(scenes)
    found, seconds = on_gpu(scenes)
    apart = max(float(np.abs(one - two).max()) for one, two in zip(found, expected, strict=True))
    others = int((found.status != expected.status).sum())
    print(f"{len(scenes.x):,} states of {scenes.kind.shape[1]} rows: {seconds * 1e3:.3f} ms")
    print(f"largest difference to the core: {apart:.1e}; other statuses: {others}")


if __name__ == "__main__":
    main()
