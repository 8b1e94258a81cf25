"""The programs for two inputs, exact and compiled: the feasible set is a convex polygon."""
