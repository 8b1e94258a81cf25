"""The Unitree A1, and other robots with its joints."""
