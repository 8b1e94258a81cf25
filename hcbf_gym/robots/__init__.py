"""Legged robots with the joints of the Unitree A1, read from MJCF files."""
