"""The tolerances of the programs that Python reads, each with its reason.

`core/include/hcbf/tolerances.hpp` has those of the core. Lengths are relative to the size of U;
settings of third-party solvers are in `general.qp`.
"""

from hcbf_gym import _core

NOMINAL: float = _core.TOLERANCE_NOMINAL
"""An input within it of u*, relative to 1 + max‖u‖, is u*."""

ZERO_GRADIENT: float = _core.TOLERANCE_ZERO_GRADIENT
"""A row with a smaller gradient is a constant: no input changes its violation."""

# ------------------------------------------------------------------ any number of inputs

DEPENDENT = 1e-9
"""A unit row whose part along the free directions is smaller does not bind them."""

MET: float = _core.TOLERANCE_MET
"""A row that misses its bound by less in the input space, relative to 1 + ‖u‖, is met."""

PRIMAL = 1e-7
"""The distance by which a solver's point may miss a row (of norm 1/2 to 1), relative to 1 + ‖x‖,
before it is not believed."""

GRADED_FOR_SOLVERS = 1e3
"""Rows of one stage that differ more in steepness are left to rational arithmetic: proximal points
would not settle."""

SETTLED = 1e-11
"""Proximal points that move by less, relative to 1 + ‖u‖, have converged."""

PULL = 1e4
"""The largest weight of a proximal problem: a stronger pull would leave DAQP no digits."""
