"""What the node must show, on its core, with clocks of its own and simulated robots.

    python -m benchmarks.ros.suites [part …] [--quick]

Without a name all parts run. What needs rclpy is in `live` and `latency`.
"""

import argparse
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.ros import bent, errands, faults, foreign, gaps, wedge
from hcbf_gym.errors import SafetyWarning


def of_faults(quick: bool) -> Iterator[str]:
    """Yield fault by fault how many trials passed."""
    trials = 3 if quick else 100
    yield f"{trials} trials each: in time, stands, named, again"
    for name in faults.CASES:
        found = [faults.try_case(name, seed) for seed in range(trials)]
        counts = [sum(bool(one[k]) for one in found) for k in range(4)]
        away = max(one.away for one in found)
        yield f"{name:26} {' '.join(f'{n:4}' for n in counts)}   {away:.2f} m"
        for seed, one in enumerate(found):
            if not all(one[:4]):
                yield f"   MISS seed {seed}: {one[:4]} {str(one.says)[:200]}"


def of_bent(quick: bool) -> Iterator[str]:
    """Yield what came of bent parameter files."""
    count = 20 if quick else 200
    with tempfile.TemporaryDirectory() as folder:
        found = bent.run(count, Path(folder))
    refused = sum(one.refused for one in found)
    named = sum(one.refused and one.named for one in found)
    same = sum(not one.refused and one.harmless for one in found)
    yield f"{count} files: {refused} refused, {named} of them by name; {count - refused} taken, "
    yield f"{same} of them the sound file in other words"
    for seed, one in enumerate(found):
        if not one.is_well:
            yield f"   MISS seed {seed}: {one.name} = {one.value!r}: {one.says[:200]}"


PARTS: dict[str, Callable[[bool], Iterator[str]]] = {
    "faults": of_faults,
    "bent": of_bent,
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
    parser = argparse.ArgumentParser(description="What the node must show, on its core.")
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], help="which; all without one")
    parser.add_argument("--quick", action="store_true", help="the short form that tests run")
    given = parser.parse_args()
    sys.exit(main(given.parts, given.quick) > 0)
