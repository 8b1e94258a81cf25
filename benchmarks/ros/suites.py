"""Suites of the node on its core, with simulated clocks and robots.

    python -m benchmarks.ros.suites [part …] [--quick]

Without a name all parts run. Those that need rclpy are `live`, `live_faults` and `latency`.
"""

import argparse
import sys
import time
import warnings
from collections.abc import Callable, Iterator

from benchmarks.ros import errands, faults, foreign, gaps, malformed, wedge
from hcbf_gym.errors import SafetyWarning

PARTS: dict[str, Callable[[bool], Iterator[str]]] = {
    "faults": faults.lines,
    "malformed": malformed.lines,
    "foreign": foreign.lines,
    "wedge": wedge.lines,
    "gaps": gaps.lines,
    "errands": errands.lines,
}
"""name → lines; one with MISS in it is a miss."""


def main(parts: list[str], quick: bool) -> int:
    """Print all parts, and return how many lines are misses."""
    misses = 0
    for name in parts or PARTS:
        begun = time.perf_counter()
        print(f"{name}:", flush=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SafetyWarning)
            for line in PARTS[name](quick):
                misses += "MISS" in line
                print(f"  {line}", flush=True)
        print(f"  {time.perf_counter() - begun:.0f} s", flush=True)
    return misses


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Suites of the node on its core.")
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], help="which; all without one")
    parser.add_argument("--quick", action="store_true", help="the short form that tests run")
    given = parser.parse_args()
    sys.exit(main(given.parts, given.quick) > 0)
