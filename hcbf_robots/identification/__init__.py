"""Identification: measures how a robot follows the velocities that it is commanded."""
