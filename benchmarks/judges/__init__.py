"""Exact solutions in rational arithmetic, without a line of the programs that they judge."""
