"""Constants of nature."""

GRAVITY = 9.81
"""On the ground [m/s²]."""
