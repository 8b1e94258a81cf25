// The pseudo-inverse of a small matrix: pairs of columns are turned until all are orthogonal (Jacobi), then
// g⁺ = V diag(1/σ²) (g V)ᵀ with σ their lengths; those below EPSILON of the greatest count as 0.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/arrays.hpp>

namespace hcbf::pseudo_inverse {

constexpr double EPSILON = 1e-15;
constexpr int MOST_SWEEPS = 30;

// Turns two columns.
inline void turn(Matrix<double> part, Index i, Index j, double cos, double tan) {
  for (Index k = 0; k < part.rows; ++k) {
    const double first = part(k, i), second = part(k, j);
    part(k, i) = cos * (first - tan * second);
    part(k, j) = cos * (second + tan * first);
  }
}

// The squared length of a column.
inline double squared(Matrix<const double> columns, Index j) {
  double sum = 0.0;
  for (Index k = 0; k < columns.rows; ++k) sum += columns(k, j) * columns(k, j);
  return sum;
}

// Writes g⁺ (n_u, n) of g (n, n_u). `columns` (n, n_u) and `turns` (n_u, n_u) are written to.
inline void write(Matrix<const double> g, Matrix<double> out, Matrix<double> columns, Matrix<double> turns) {
  const Index n = g.rows, n_u = g.columns;
  std::copy_n(g.data, n * n_u, columns.data);
  std::fill_n(turns.data, n_u * n_u, 0.0);
  for (Index j = 0; j < n_u; ++j) turns(j, j) = 1.0;
  bool still = false;
  for (int sweep = 0; sweep < MOST_SWEEPS && !still; ++sweep) {
    still = true;
    for (Index i = 0; i < n_u; ++i)
      for (Index j = i + 1; j < n_u; ++j) {
        double a = 0.0, b = 0.0, along = 0.0;
        for (Index k = 0; k < n; ++k) {
          a += columns(k, i) * columns(k, i);
          b += columns(k, j) * columns(k, j);
          along += columns(k, i) * columns(k, j);
        }
        if (!(std::abs(along) > EPSILON * std::sqrt(a * b))) continue;
        still = false;
        const double twist = (b - a) / (2.0 * along);
        double tan = 1.0 / (std::abs(twist) + std::sqrt(1.0 + twist * twist));
        if (!(twist >= 0.0)) tan = -tan;
        const double cos = 1.0 / std::sqrt(1.0 + tan * tan);
        turn(columns, i, j, cos, tan);
        turn(turns, i, j, cos, tan);
      }
  }
  double largest = 0.0;
  for (Index j = 0; j < n_u; ++j) largest = std::max(largest, squared(columns, j));
  std::fill_n(out.data, n_u * n, 0.0);
  for (Index j = 0; j < n_u; ++j) {
    const double size = squared(columns, j);
    if (!(size > EPSILON * EPSILON * largest)) continue;
    for (Index i = 0; i < n_u; ++i)
      for (Index k = 0; k < n; ++k) out(i, k) += turns(i, j) / size * columns(k, j);
  }
}

}  // namespace hcbf::pseudo_inverse
