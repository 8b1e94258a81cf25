"""How a barrier stands in the arrays that the compiled kernels read.

A barrier is a kind, an integer, and a block of `WIDTH` numbers. Small kinds are the shapes: each
has a file in `shapes`, which names the columns of its block. No other module knows a column by its
number.
"""

SPEED_LIMIT, CUSTOM = 100, 101
"""The kinds that are no shape; CUSTOM stands for a user's own barrier, which Python evaluates."""

LOWEST_RANK = 64
"""The largest number that a priority may be: compiled code has room for so many levels."""

VELOCITY_X, VELOCITY_Y = 0, 1  # of the frame of a shape [m/s]
V_MAX = 2  # of a speed limit [m/s]

WIDTH = 19
"""Numbers of a block: the velocity, and what the shape with the most columns needs."""
