"""Constants of nature, and the numbers beyond which nothing makes sense."""

GRAVITY = 9.81
"""On the ground [m/s²]."""

FARTHEST = 1e4
"""Of anything from the origin [m]: beyond, rounding is not small beside a contact's depth."""
