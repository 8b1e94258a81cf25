// What goes into a program and comes out: settings, rows, prices, the answer, working space.
//
// The rows are the conditions a_k u >= b_k. With psi the barrier at its relative degree, a = L_g psi and
// b = -alpha2(psi) - L_f psi, so that a u - b = d psi/dt (x, u) + alpha2(psi). A relaxed row costs
// lambda(h) = gamma0 where h > 0, else gamma0 (1 + delta_gamma |h|).
#pragma once
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <hcbf/layout.hpp>
#include <hcbf/arrays.hpp>
#include <hcbf/polygon.hpp>

namespace hcbf::program_records {

using namespace functions;
using polygon::LineOf, polygon::Point, polygon::PointOf, polygon::PolygonOf;

// What the rows that are not strict pay for; as numbers, what NumPy records hold.
enum class Lower : Index { NOTHING, RELAXED, DRAWN };
// What a level locks.
enum class Lock : Index { NOTHING, PIN, BOUND };

// A program: its plan, its prices and U. K is 1, or N for N states with a U or weights of their own.
struct Settings {
  Lower lower;
  bool by_level;  // whether each priority is a stage; if not there are two, strict rows and others
  Lock lock;
  bool ranks;     // whether rows of priority 1 come before the others
  bool guided;    // whether guidance may add a row of the last rank, which costs the others nothing
  double radius;  // the largest norm of an input in U
  double lambda_u;
  bool known_offset;             // whether the least slack comes from alpha2(psi); 0 if not
  Cube<const double> vertices;   // (K, V, 2) the corners of U, counter-clockwise
  Matrix<const double> weights;  // (K, 1 + L) see `weights`
};

template <class Number>
struct StateRowsOf {                // of one state
  Matrix<const Number> a;           // (m, n_u) L_g psi_k, the row's gradient in the input
  Vector<const Number> b;           // (m,) the row's lower bound
  Vector<const Number> h;           // (m,) the barriers' values
  Vector<const Index> priority;     // (m,) 1 is the highest and strict; 0 is of no row
  Vector<const Number> alpha2_psi;  // (m,) alpha2(psi_k)
};
using StateRows = StateRowsOf<double>;

struct CbfRows {  // of N states
  Cube<const double> a;
  Matrix<const double> b, h;
  Matrix<const Index> priority;
  Matrix<const double> alpha2_psi;
  StateRows operator[](Index i) const { return {a[i], b[i], h[i], priority[i], alpha2_psi[i]}; }
};

// Returns whether priorities are 1, 2, ... without a gap.
inline bool has_no_gap(Vector<const Index> priority) {
  Index levels = 0;
  for (const Index rank : priority) {
    if (rank < 1 || rank > priority.size) return false;
    levels = std::max(levels, rank);
  }
  for (Index level = 1; level <= levels; ++level)
    if (std::find(priority.begin(), priority.end(), level) == priority.end()) return false;
  return true;
}

// Returns whether the rows are finite, with priorities 1, 2, ... without a gap.
inline bool well_formed(const StateRows& rows) {
  const Vector<const double> gradients{rows.a.data, rows.a.rows * rows.a.columns};
  return are_finite(gradients) && are_finite(rows.b) && are_finite(rows.h) && has_no_gap(rows.priority);
}

// Of several that apply, the status is the last; see `FilterStatus` in hcbf_gym/programs/result.py.
enum FilterStatus : Index { NOMINAL, SAFE, RELAXED, VIOLATED, UNSAFE, BACKUP };

struct FilterResult {       // of N states, written to
  Matrix<double> u;         // (N, n_u) the filtered inputs, in U
  Matrix<double> slack;     // (N, m) violation of each row at u, max(0, b_k - a_k u)
  Matrix<double> delta;     // (N, m) the program's own relaxation of each row
  Vector<Index> status;     // (N,) `FilterStatus`
  Vector<Index> fallbacks;  // (N,) how many projections took more than doubles or a second solver
};

// What is known of a row on the cell of a search: nothing yet, that it is paid for, that it is not.
enum class State { OPEN, PAID, MET };

// What the stages read of a row, for any number of inputs.
template <class Number>
struct TermsOf {
  Index index;    // where it stood before rows were sorted by stage
  Number norm;    // |a|
  Number b;       // bound, a u >= b
  bool strict;    // whether the stage meets the row, instead of paying for it
  Number weight;  // lambda(h); 1 for a strict row
  Number least;   // the least slack; 0 for a strict row
  Number target;  // a u_k, u_k the solution of the row's own program

  // Whether it is more than a constant.
  bool steers() const { return norm > tolerances::ZERO_GRADIENT; }
};
using Terms = TermsOf<double>;

// A row of two inputs.
template <class Number>
struct RowOf : TermsOf<Number> {
  using TermsOf<Number>::norm, TermsOf<Number>::b, TermsOf<Number>::least;
  PointOf<Number> a;  // gradient
  State state;        // of `soft_minimum`

  Number value(const PointOf<Number>& u) const { return polygon::dot(a, u); }
  // The violation, and its excess over the least slack.
  Number lack(const PointOf<Number>& u) const { return b - a.x * u.x - a.y * u.y; }
  Number excess(const PointOf<Number>& u) const { return b - least - a.x * u.x - a.y * u.y; }
  // Its line a u = bound, if it steers.
  LineOf<Number> line(const Number& bound) const { return {{a.x / norm, a.y / norm}, bound / norm}; }
  // Its line through a point.
  LineOf<Number> through(const PointOf<Number>& u) const {
    const PointOf<Number> n{a.x / norm, a.y / norm};
    return {n, polygon::dot(n, u)};
  }
};

template <class Number>
using RowsOf = Vector<RowOf<Number>>;
using Row = RowOf<double>;

// lambda_u |u - u*|^2 + sum w_k max(m_k, b_k - a_k u)^2 over the rows of one stage.
template <class Number>
struct CostOf {
  RowsOf<Number> rows;
  double lambda_u;
  PointOf<Number> u_nominal;
};
using Cost = CostOf<double>;

// What the stages write to; made once for a whole batch, or for a scene.
template <class Number>
struct WorkspaceOf {
  double radius = 0.0;                   // the largest norm of an input, which sets the scale of rounding
  PolygonOf<Number> feasible;            // the inputs that the stages so far leave
  PolygonOf<Number> trial, cell, chord;  // what stages, `soft_minimum` and `minimise` cut
  std::vector<RowOf<Number>> rows;       // (m,) sorted by stage
  std::vector<Index> start;              // where each stage's rows start, as far as there are stages

  // Makes room for a U with so many corners, and m rows.
  void grow(double new_radius, Index corners, Index m) {
    radius = new_radius;
    for (PolygonOf<Number>* each : {&feasible, &trial, &cell, &chord}) each->reserve(corners + m + 4);
    rows.resize(std::max<Index>(m, rows.size()));
    const Index ranks = std::max(m, layout::LOWEST_RANK) + 4;  // guidance may be below the lowest
    start.resize(std::max<Index>(ranks, start.size()));
  }
};
using Workspace = WorkspaceOf<double>;

}  // namespace hcbf::program_records
