"""The layout of a barrier in the arrays that compiled code reads.

A barrier is an integer, its kind, and a block of `WIDTH` numbers. The kinds below 100 are shapes.
Each shape has a file in `shapes`, which names the columns of its block.
"""

SPEED_LIMIT, CUSTOM, MAPPED, ZONES, ZONE, NONE = range(100, 106)
"""The kinds that are no shape.

CUSTOM is a user's own barrier, which Python evaluates. MAPPED is a class of a map that is a region,
and ZONES one of speed zones; both have many pieces in the atlas of a set. ZONE is the nearest zone
from one state. NONE fills up scenes that are shorter than others of a batch. It has rank 0, no row
and no margin, and is reported as a barrier that is infinitely far.
"""

ELSEWHERE = -1
"""The kind of a `Function`, whose row JAX makes."""

LOWEST_RANK = 64
"""The largest priority: compiled code has room for so many levels."""

VELOCITY_X, VELOCITY_Y = 0, 1  # of the frame of a shape [m/s]
V_MAX = 2  # of a speed limit and of zones [m/s]
PIECES = 3  # of a class of a map: the index of its first piece's numbers in the atlas
KEPT = 4  # of ZONES: what is reserved around their cells [m]
AWAY, AWAY_X, AWAY_Y = 3, 4, 5  # of ZONE: the distance to it [m], and the gradient of that

WIDTH = 19
"""The size of a block: the velocity, and the columns of the shape that has the most."""
