"""The programs for any number of inputs, through a QP solver."""
