"""Constants of nature, and the numbers beyond which nothing makes sense."""

from hcbf_gym import _core

GRAVITY = _core.GRAVITY
"""On the ground [m/s²]."""

FARTHEST = _core.FARTHEST
"""Of anything from the origin [m]: beyond, rounding is not small beside a contact's depth."""
LONGEST = 1e4
"""Of the time between two samples [s]: beyond, nothing that is propagated is of use."""
ON_EARTH = 5e7
"""Of regions and maps from the origin of a survey, such as UTM's, before they are shifted [m]."""
STANDING = _core.STANDING
"""Slower than that a robot is at rest [m/s]."""
ASKING = _core.ASKING
"""A policy that requests more than that is to move [m/s²]."""
