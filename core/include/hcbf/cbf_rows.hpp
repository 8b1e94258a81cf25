// The record between barriers and programs: the conditions a_k u >= b_k of each state.
//
// With psi the barrier at its relative degree, a = L_g psi and b = -alpha2(psi) - L_f psi, so that
// a u - b = d psi/dt (x, u) + alpha2(psi).
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/arrays.hpp>

namespace hcbf::cbf_rows {

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

inline bool are_finite(Vector<const double> numbers) {
  return std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); });
}

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

}  // namespace hcbf::cbf_rows
