"""The layout of a barrier in the arrays that compiled code reads.

A barrier is an integer, its kind, and a *block* of `WIDTH` numbers. The kinds below 100 are shapes.
Each shape has a file in `shapes`, which names the columns of its block.
"""

SPEED_LIMIT, CUSTOM, MAPPED, ZONES, ZONE, NONE = range(100, 106)
"""The kinds that are no shape.

- CUSTOM is a user's own barrier, which Python evaluates.
- MAPPED is a class of a map that is a region, and ZONES one of speed zones. Both have many pieces
  in the atlas of a set.
- ZONE is the nearest zone from one state.
- NONE is an empty place, at the end of a scene that is shorter than others of a batch. It has rank
  0, no row and no margin, and is reported as a barrier that is infinitely far.
"""

ELSEWHERE = -1
"""The kind of a `Function`, whose row JAX makes."""

LOWEST_RANK = 64
"""The largest priority: compiled code has room for so many levels."""

VELOCITY_X, VELOCITY_Y = 0, 1  # the velocity of a shape's frame [m/s]
V_MAX = 2  # the limit of SPEED_LIMIT, ZONES and ZONE [m/s]
PIECES = 3  # the index in the atlas at which the pieces of MAPPED and ZONES begin
KEPT = 4  # the distance that ZONES reserve around their cells [m]
AWAY, AWAY_X, AWAY_Y = 3, 4, 5  # the distance to a ZONE [m], and its gradient in the position

WIDTH = 19
"""The size of a block: the velocity, and the columns of the shape that has the most."""
