"""`make core`: compile what has changed of `core/` into `hcbf_gym/`.

With --sanitize, so that it ends at the first access beyond an array or undefined operation.
"""

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def compile_in_place(folder: str, *options: str) -> None:
    """Compile the core into `hcbf_gym/`, with CMake's files in a folder, and with its options."""
    settings = f"-DPython_EXECUTABLE={sys.executable}", "-DHCBF_IN_PLACE=ON", *options
    generator = ("-G", "Ninja") if shutil.which("ninja") else ()
    subprocess.run(["cmake", *generator, "-S", ROOT / "core", "-B", folder, *settings], check=True)
    subprocess.run(["cmake", "--build", folder, "--parallel"], check=True)


if __name__ == "__main__":
    if importlib.util.find_spec("nanobind") is None or shutil.which("cmake") is None:
        sys.exit("make core: got no nanobind or CMake, expected: pip install -e '.[core]'")
    SANITIZE = "--sanitize" in sys.argv[1:]
    FOLDER = ROOT / "build" / ("sanitized" if SANITIZE else "core")
    compile_in_place(str(FOLDER), f"-DHCBF_SANITIZE={'ON' if SANITIZE else 'OFF'}")
