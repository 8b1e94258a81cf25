"""Rational arithmetic for levels whose least squares do not fit into doubles."""
