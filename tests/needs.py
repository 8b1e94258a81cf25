"""What tests need beyond the extra `test`: without it they are skipped, with the remedy."""

import importlib.util
import re
import shutil

import pytest

EXTRAS = {
    "jax": "jax",
    "cbfpy": "benchmark",
    "gymnasium_robotics": "examples",
    "stable_baselines3": "rl",
    "torch": "rl",
    "onnxruntime": "walkers",
    "ray": "cluster",
    "rclpy": "ros-wheels",
}
"""module → the extra of this package that brings it."""


def remedy(module):
    """Say which extra brings a module."""
    extra = EXTRAS[module]
    return f"needs {module} of the extra {extra}: pip install -c constraints.txt -e '.[{extra}]'"


def needs(*modules):
    """Skip a test where one of these modules is not installed."""
    missing = [remedy(name) for name in modules if importlib.util.find_spec(name) is None]
    return pytest.mark.skipif(bool(missing), reason="; ".join(missing))


def imported(code):
    """Return the modules of `EXTRAS` that code imports, be it a file, a page's or a docstring's."""
    found = re.findall(r"^[ .>]*(?:from|import) (\w+)", code, flags=re.MULTILINE)
    return [name for name in dict.fromkeys(found) if name in EXTRAS]


def chromium():
    """Return the browser's path; without one, skip."""
    path = shutil.which("chromium") or shutil.which("google-chrome")
    return path or pytest.skip("needs Chromium: apt-get install chromium")
