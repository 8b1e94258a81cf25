"""Filters beside what is known exactly of a held double integrator."""
