"""Every tolerance of the programs, each with its reason; lengths are relative to the size of U.

What is left out are the settings of third-party solvers, which stand beside them in `general.qp`.
"""

from hcbf_gym import _core

SLACK = 1e-8
"""A violation below it, relative to ‖a_k‖ max‖u‖ + |b_k|, is rounding; the row counts as met."""

NOMINAL: float = _core.TOLERANCE_NOMINAL
"""An input within it of u*, relative to 1 + max‖u‖, is u*."""

ZERO_GRADIENT: float = _core.TOLERANCE_ZERO_GRADIENT
"""A row with a smaller gradient is a constant: no input changes its violation."""

# ------------------------------------------------------------------ polygons

THIN = 1e-10
"""A polygon narrower than it is a segment, and a point nearer to a line lies on it: corners come
from crossings, whose rounding is of the order 1e-16 over the sine of an angle down to 1e-6."""

SAME_CORNER = 1e-14
"""Corners nearer to each other are one: `THIN` would erase sides that a crossing just made."""

RANK_ONE = 1e-12
"""Where |det R| is smaller, relative to ‖R‖², the flat direction of a least-squares problem is
rounding, and u* decides along it."""

OUTWARD = 1e-12
"""The sine of an angle by which a direction may leave a cell and still run along its border."""

# ------------------------------------------------------------------ stages of violations

GRADED = 1e4
"""Rows of one stage that are flatter than the steepest by more are decided after the steep ones:
squared, the difference would eat half of the digits of their least squares."""

NEGLIGIBLE = 1e-11
"""A violation whose share of the root of a stage's cost is smaller is the rounding of steeper
rows: the row counts as met when the stage is locked."""

SURELY_PAID = 1e-6
"""A row that pays by less, relative to ‖a_k‖ max‖u‖, may be there to hold back a flatter one: the
guess which rows pay is not believed."""

SURELY_MET = 1e-14
"""A row that is missed by more, relative to ‖a_k‖ max‖u‖ + |b_k|, is not met: likewise. By less, it
is at its kink, and pushes nowhere."""

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
