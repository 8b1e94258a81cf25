"""Environments of robots that take velocities."""
