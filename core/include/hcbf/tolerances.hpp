// Every tolerance of the programs, each with its reason; lengths are relative to the size of U.
// hcbf_gym/programs/qp.py has those of QP solvers by name.
#pragma once

namespace hcbf::tolerances {

// A violation below it, relative to |a_k| max|u| + |b_k|, is rounding; the row counts as met.
constexpr double SLACK = 1e-8;
// An input within it of u*, relative to 1 + max|u|, is u*.
constexpr double NOMINAL = 1e-9;
// A row with a smaller gradient is a constant: no input changes its violation.
constexpr double ZERO_GRADIENT = 1e-12;

// ---------------------------------------------------------------- polygons
// A polygon narrower than it is a segment, and a point nearer to a line is on it: corners come
// from crossings, whose rounding is of the order 1e-16 over the sine of an angle down to 1e-6.
constexpr double THIN = 1e-10;
// Corners nearer to each other are one: `THIN` would erase sides that a crossing just made.
constexpr double SAME_CORNER = 1e-14;
// Where |det R| is smaller, relative to |R|^2, the flat direction of a least-squares problem is
// rounding, and u* decides along it.
constexpr double RANK_ONE = 1e-12;
// The sine of an angle by which a direction may leave a cell and still run along its border.
constexpr double OUTWARD = 1e-12;

// ---------------------------------------------------------------- stages of violations
// Rows of one stage that are flatter than the steepest by more are decided after the steep ones:
// squared, the difference would eat half of the digits of their least squares.
constexpr double GRADED = 1e4;
// A violation whose share of the root of a stage's cost is smaller is the rounding of steeper
// rows: the row counts as met when the stage is locked.
constexpr double NEGLIGIBLE = 1e-11;
// A row that pays by less, relative to |a_k| max|u|, may be there to hold back a flatter one: the
// guess which rows pay is not accepted.
constexpr double SURELY_PAID = 1e-6;
// Nor is it where a row counts as met that is missed by more, relative to |a_k| max|u| + |b_k|.
// One that is missed by less is at its kink, and pushes nowhere.
constexpr double SURELY_MET = 1e-14;

// ---------------------------------------------------------------- any number of inputs
// A row that misses its bound by less in the input space, relative to 1 + |u|, is met.
constexpr double MET = 1e-9;
// A unit row whose part along the free directions is smaller does not bind them.
constexpr double DEPENDENT = 1e-9;
// A row that misses its bound by more, relative to 1 + max|x|, beside rows that leave it no freedom
// proves that a polyhedron is empty.
constexpr double MISSED = 1e-9;
// A point that misses a row by more, relative to 1 + max|x|, is computed with twice the digits.
constexpr double PRIMAL = 1e-7;
// Rows of one stage that differ more in steepness, or whose bounds are farther, relative to the
// steepest, take twice a double's digits.
constexpr double GRADED_FOR_SOLVERS = 1e3;
// How much dearer than a distance a violation of the steepest row is in a proximal problem, for a solver
// by name and in doubles; and of the flattest, with twice the digits, up to a limit for the steepest.
// More would leave too few digits.
constexpr double PULL_BY_NAME = 1e4, PULL = 1e8, PULL_OF_FLATTEST = 1e6, LARGEST_PULL = 1e26;
// Proximal points that move by less, relative to 1 + max|u|, have converged.
constexpr double SETTLED = 1e-11;

}  // namespace hcbf::tolerances
