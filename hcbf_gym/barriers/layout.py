"""How a barrier is written in the arrays that the compiled kernels read.

A barrier is a kind, an integer, and a block of `WIDTH` numbers. Small kinds are the shapes: each
has a file in `shapes`, which names the columns of its block.
"""

SPEED_LIMIT, CUSTOM, MAPPED, ZONES, ZONE, NONE = range(100, 106)
"""The kinds that are no shape.

CUSTOM is a user's own barrier, which Python evaluates. MAPPED and ZONES are a class of a map, many
pieces in the atlas of a set, a region and speed zones; ZONE is one zone as it is seen from one
state. NONE is no condition: it fills up scenes that are shorter than others of a batch. It has rank
0, no row and no margin, and is reported as a condition that is infinitely far.
"""

ELSEWHERE = -1
"""The kind of a barrier whose row is made elsewhere: a function."""

LOWEST_RANK = 64
"""The largest number that a priority may be: compiled code has room for so many levels."""

VELOCITY_X, VELOCITY_Y = 0, 1  # of the frame of a shape [m/s]
V_MAX = 2  # of a speed limit and of zones [m/s]
PIECES = 3  # of a class of a map: where its pieces begin in the atlas
KEPT = 4  # of zones: what is reserved around their cells [m]
AWAY, AWAY_X, AWAY_Y = 3, 4, 5  # of one zone: the distance to it [m], and its gradient

WIDTH = 19
"""Numbers of a block: the velocity, and what the shape with the most columns needs."""
