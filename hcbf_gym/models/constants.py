"""Gravity, and the bounds beyond which a number is taken for an error."""

from hcbf_gym import _core

GRAVITY = _core.GRAVITY
"""The acceleration of gravity [m/s²]."""
FARTHEST = _core.FARTHEST
"""The greatest distance from the origin [m]. Beyond, rounding errors are no longer small compared
with the depth of a contact."""
LONGEST = 1e4
"""The longest time between two samples [s]: a state propagated for longer is useless."""
ON_EARTH = 5e7
"""The greatest distance of regions and maps from the origin of a survey, such as UTM's, from which
they are shifted to the plant's start [m]."""
STANDING = _core.STANDING
"""A robot that moves more slowly is at rest [m/s]."""
ASKING = _core.ASKING
"""A policy with a larger nominal input requests the robot to move [m/s²]."""
