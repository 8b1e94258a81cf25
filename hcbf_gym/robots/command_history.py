"""What is remembered of a robot's commands, and the numbers of its response.

`response_monitor` has the law; `command_history.hpp` and `response_monitor.hpp` follow it.
"""

import numpy as np

WINDOWS = 7
"""How many windows there are, each twice as long as the one before."""
HELD = 256
"""Commands that are remembered: the delay's worth of the fastest controller."""

NOTES = np.dtype(
    [
        ("told_at", "f8", HELD),  # [s]
        ("told", "f8", (HELD, 3)),  # what they lead to: gain × command, in the plane [m/s], turning
        ("ends", "i8", HELD),  # whether it is the end of a command that was not renewed
        ("count", "i8"),  # of all that were told
        ("acting", "i8"),  # the number of the one that acts
        ("velocity", "f8", 2),  # v̂ in the robot's axes [m/s]
        ("braked", "f8", 2),  # v_b in the robot's axes [m/s]
        ("place", "f8", 3),  # x, y [m] and heading [rad] at the last sample
        ("time", "f8"),  # of it [s]
        ("begun", "i8"),  # whether there is one
        ("missed", "f8", (WINDOWS, 2)),  # r [m]
        ("moved", "f8", WINDOWS),  # m [m]
        ("doubt", "f8", WINDOWS),  # d [m]
        ("apart", "f8", (WINDOWS, 2)),  # q [m]
        ("widest", "f8", WINDOWS),  # the greatest ‖q‖ of late [m]
        ("seen", "f8", WINDOWS),  # w [s]
        ("missing", "f8", (2, 2)),  # c [m²/s]
        ("asked", "f8", 2),  # E [m²/s]
        ("hidden", "f8", 2),  # d of it [m²/s]
        ("worst", "f8"),  # the greatest share of a bound at the last sample
    ]
)

LAW = np.dtype(
    [
        ("tau", "f8"),  # [s]
        ("delay", "f8"),  # δ [s]
        ("first", "f8"),  # W₀ [s]
        ("most", "f8"),  # K S [m/s]
        ("lasting", "f8"),  # D [m/s]
        ("share", "f8"),  # a
        ("braking", "f8"),  # how hard a stop brakes [m/s²]
        ("overshoot", "f8"),  # by how much the speed exceeds all commands [m/s]
        ("arc", "f8"),  # A; 0 of a robot that was measured
        ("forward", "f8"),  # the greatest speed that the robot may be told [m/s]
    ]
)
