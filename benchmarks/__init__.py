"""The evidence of the project, run from a checkout; the package neither imports nor mentions it."""
