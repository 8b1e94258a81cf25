"""Every program in random scenes that start in conflict."""
