// A program's answer: the input, what each row pays for it, and how they relate.
#pragma once
#include <hcbf/arrays.hpp>
#include <hcbf/dual.hpp>
#include <hcbf/tolerances.hpp>

namespace hcbf::result {

// Of several that apply, the status is the last; see `FilterStatus` in hcbf_gym/programs/result.py.
enum FilterStatus : Index { NOMINAL, SAFE, RELAXED, VIOLATED, UNSAFE, BACKUP };

struct FilterResult {       // of N states, written to
  Matrix<double> u;         // (N, n_u) the filtered inputs, in U
  Matrix<double> slack;     // (N, m) violation of each row at u, max(0, b_k - a_k u)
  Matrix<double> delta;     // (N, m) the program's own relaxation of each row
  Vector<Index> status;     // (N,) `FilterStatus`
  Vector<Index> fallbacks;  // (N,) how many projections took more than doubles or a second solver
};

// Returns by how much a row is violated, 0 where that is rounding. `lack`: b - a u; `norm`: |a|;
// `radius`: the largest norm of an input.
template <class Number>
Number slack_of(const Number& lack, const Number& norm, const Number& b, double radius) {
  using namespace functions;
  return lack > tolerances::SLACK * (norm * radius + abs(b)) ? lack : 0.0;
}

// Writes the slack (m,) of one state's rows at u.
inline void violation(Matrix<const double> a, Vector<const double> b, Vector<const double> u, double radius,
                      Vector<double> slack) {
  for (Index k = 0; k < b.size; ++k) {
    double square = 0.0, lack = b[k];
    for (Index j = 0; j < u.size; ++j) square += a(k, j) * a(k, j), lack -= a(k, j) * u[j];
    slack[k] = slack_of(lack, std::sqrt(square), b[k], radius);
  }
}

}  // namespace hcbf::result
