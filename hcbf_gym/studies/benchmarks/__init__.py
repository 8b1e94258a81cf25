"""Measurements of the package, each with the command that repeats it."""
