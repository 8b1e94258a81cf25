"""Suites of the node on its core, with simulated clocks and robots.

``python -m benchmarks.ros.suites [part …] [--quick]``. Those that need rclpy are `live` and
`live_faults`.
"""

import sys
import time
import warnings
from collections.abc import Callable, Iterator

import tyro

from benchmarks.ros import errands, faults, foreign, malformed, wedge
from hcbf_gym.errors import SafetyWarning, choose

PARTS: dict[str, Callable[[bool], Iterator[str]]] = {
    "faults": faults.lines,
    "malformed": malformed.lines,
    "foreign": foreign.lines,
    "wedge": wedge.lines,
    "errands": errands.lines,
}
"""name → lines; one with MISS in it is a miss."""


def main(parts: tyro.conf.Positional[tuple[str, ...]] = tuple(PARTS), quick: bool = False) -> int:
    """Print parts, and return how many lines are misses.

    Args:
        parts: which.
        quick: the short form that tests run.
    """
    misses = 0
    warnings.simplefilter("ignore", SafetyWarning)
    for name in parts:
        begun = time.perf_counter()
        print(f"{name}:", flush=True)
        for line in choose("part", name, PARTS)(quick):
            misses += "MISS" in line
            print(f"  {line}", flush=True)
        print(f"  {time.perf_counter() - begun:.0f} s", flush=True)
    return misses


if __name__ == "__main__":
    sys.exit(tyro.cli(main) > 0)
