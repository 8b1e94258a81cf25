"""Fault by fault through real rclpy: the node in another process, on the robot's clock.

    python -m benchmarks.ros.live_faults [trials]

The cases are those of `faults`; planner, odometry, scan, map and /clock are this process. Three
trials take six minutes.
"""
# pyright: reportMissingImports=false

import sys
import time

import numpy as np
from lifecycle_msgs.msg import Transition

from benchmarks.ros.faults import CASES
from benchmarks.ros.rig import PERIOD, SLACK, Base, filtered

PARAMETERS = """hcbf_filter:
  ros__parameters:
    use_sim_time: true
    max_forward: 1.0
    max_turn: 2.0
    look_ahead: 0.2
    reach: 0.3
    observation_sources: [scan, map]
    scan: {type: scan, topic: scan, source_timeout: 0.5}
    map: {type: map, topic: map, unknown: 0, source_timeout: 0.9}
"""
HELD_UP = 0.1
"""A trial in which the machine held this process up for longer is repeated: that is a fault [s]."""
LATE = 0.1
"""For what comes in the period of its messages, beside the case's own [s]."""


def try_case(base: Base, name: str, rng: np.random.Generator) -> str:
    """Let one fault happen; return "" if all is well, else what is wrong."""
    case, planner = CASES[name], base.planner
    planner.spin(0.3 + rng.uniform(0.0, 0.1))
    if not planner.spin(3.0, planner.moving):
        return f"stands before: {planner.message}"
    messages: list[str] = []
    planner.heard = messages.append
    begun = time.monotonic()
    base.tamper = case.tamper(base, rng) if case.tamper is not None else base.tamper
    base.without, base.rate = case.without, case.clock
    planner.spin(1.2 if case.within is None else case.within + LATE + PERIOD + SLACK + 0.3)
    given = [one for one in planner.given if one[0] > begun]
    base.without, base.rate, base.tamper = "", 1.0, lambda: None
    zero = next((k for k, one in enumerate(given) if not any(one[1:])), None)
    if case.within is None:
        return planner.message if zero is not None or not given else ""
    if zero is None:
        return f"never zero in {len(given)} messages"
    late, wrong = given[zero][0] - begun, list[str]()
    if late > case.within + LATE + PERIOD + SLACK:
        wrong.append(f"zero after {late:.2f} s")
    if case.lasts is None and any(any(one[1:]) for one in given[zero:]):
        wrong.append(f"moves again: {messages}")
    if not any(reason in one for reason in case.reason.split("|") for one in messages):
        wrong.append(f"names another reason: {messages}")
    if not planner.spin(case.again + 1.2, planner.moving):
        wrong.append(f"stands after: {planner.message}")
    planner.spin(3.0, planner.moving)
    return "; ".join(wrong)


def main(trials: int = 3) -> int:
    """Run all, print how many trials of each passed, and return how many did not."""
    begun, missed, rng = time.monotonic(), 0, np.random.default_rng(41)
    with filtered(PARAMETERS) as (planner, folder, _):
        base = planner.base = Base(planner, clock=1000.0)
        configured = planner.change(Transition.TRANSITION_CONFIGURE)
        assert configured, (folder / "node.log").read_text("utf-8")
        assert planner.change(Transition.TRANSITION_ACTIVATE)
        planner.wants = lambda: (0.3, 0.0, 0.4)
        assert planner.spin(10.0, planner.moving), planner.message
        for case in CASES:
            wrong, held = [], 0
            while len(wrong) < trials and held < 10 * trials:
                base.longest = 0.0
                found = try_case(base, case, rng)
                if base.longest > HELD_UP:
                    held += 1
                else:
                    wrong.append(found)
            passed = wrong.count("")
            missed += trials - passed
            again = f"({held} again)" if held else ""
            print(f"{case:26} {passed} of {trials}", again, *filter(None, wrong), flush=True)
    print(f"{time.monotonic() - begun:.0f} s")
    return missed


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])) > 0)
