// Small dense steps of the stages for any number of inputs: NumPy's calls would cost more than the
// QP solver.
#pragma once
#include <algorithm>
#include <cmath>
#include <vector>

#include <hcbf/arrays.hpp>
#include <hcbf/tolerances.hpp>

namespace hcbf::dense {

// Rows a x >= b, which own their numbers.
struct Rows {
  Index columns;
  std::vector<double> a, b;  // (k, columns) and (k,)
};

inline double norm(Vector<const double> v) {
  double square = 0.0;
  for (const double x : v) square += x * x;
  return std::sqrt(square);
}

inline double dot(Vector<const double> a, Vector<const double> b) {
  double sum = 0.0;
  for (Index i = 0; i < b.size; ++i) sum += a[i] * b[i];
  return sum;
}

enum class Scale { UNIT, BY_POWER };

// Returns the rows scaled to unit norm, or by powers of two to norms from 1/2 to 1, without those of
// norm `least` or below, which are constants. By powers no digit is lost, and parallel rows stay
// parallel.
inline Rows scaled_rows(Matrix<const double> a, Vector<const double> b, double least, Scale scale) {
  Rows scaled{a.columns, {}, {}};
  scaled.a.reserve(a.rows * a.columns), scaled.b.reserve(a.rows);
  for (Index k = 0; k < b.size; ++k) {
    double divisor = norm(a[k]);
    if (!(divisor > least)) continue;
    if (scale == Scale::BY_POWER) {
      int power;
      std::frexp(divisor, &power);
      divisor = std::ldexp(1.0, power);
    }
    for (const double x : a[k]) scaled.a.push_back(x / divisor);
    scaled.b.push_back(b[k] / divisor);
  }
  return scaled;
}

// Writes R (n, n) and y (n,) with |z - c|^2 + |a z - t|^2 = |R z - y|^2 + a constant.
//
// R is upper triangular and comes from Givens rotations, row by row: squares are never formed.
inline void whiten(Matrix<const double> a, Vector<const double> target, Vector<const double> centre,
                   Matrix<double> factor, Vector<double> y) {
  const Index n = centre.size;
  std::fill_n(factor.data, n * n, 0.0);
  for (Index i = 0; i < n; ++i) factor(i, i) = 1.0, y[i] = centre[i];
  std::vector<double> row(n);
  for (Index k = 0; k < target.size; ++k) {
    std::copy(a[k].begin(), a[k].end(), row.begin());
    double t = target[k];
    for (Index i = 0; i < n; ++i) {
      if (row[i] == 0.0) continue;
      const double length = std::hypot(factor(i, i), row[i]);
      const double cos = factor(i, i) / length, sin = row[i] / length;
      for (Index j = i; j < n; ++j) {
        const double above = factor(i, j), below = row[j];
        factor(i, j) = cos * above + sin * below;
        row[j] = cos * below - sin * above;
      }
      const double above = y[i];
      y[i] = cos * above + sin * t;
      t = cos * t - sin * above;
    }
  }
}

// Turns rows (k, n) into rows R^-1: as they act on y = R z.
inline void image_of_rows(Matrix<double> rows, Matrix<const double> factor) {
  for (Index k = 0; k < rows.rows; ++k)
    for (Index j = 0; j < rows.columns; ++j) {
      for (Index i = 0; i < j; ++i) rows(k, j) -= rows(k, i) * factor(i, j);
      rows(k, j) /= factor(j, j);
    }
}

// Turns y (n,) into z with R z = y.
inline void back_substitute(Matrix<const double> factor, Vector<double> y) {
  for (Index i = y.size - 1; i >= 0; --i) {
    for (Index j = i + 1; j < y.size; ++j) y[i] -= factor(i, j) * y[j];
    y[i] /= factor(i, i);
  }
}

// Returns whether x (n,) misses no row by more than tolerance (1 + max|x|); NaN fails.
inline bool meets(Matrix<const double> a, Vector<const double> lower, Vector<const double> x,
                  double tolerance) {
  double largest = 0.0;
  for (const double value : x) largest = std::isnan(value) ? value : std::max(largest, std::abs(value));
  const double allowed = tolerance * (1.0 + largest);
  for (Index k = 0; k < lower.size; ++k)
    if (!(lower[k] - dot(a[k], x) <= allowed)) return false;
  return allowed < INFINITY;
}

// Returns the rows on (z, s) of rows z >= lower, a z + s >= target and s >= least; those with a (s, n)
// come out with unit norm.
inline Rows with_slack(Matrix<const double> rows, Vector<const double> lower, Matrix<const double> a,
                       Vector<const double> target, Vector<const double> least) {
  const Index hard = lower.size, free = rows.columns, count = target.size, columns = free + count;
  Rows all{columns, std::vector<double>((hard + 2 * count) * columns), std::vector<double>(hard + 2 * count)};
  const Matrix<double> matrix{all.a.data(), hard + 2 * count, columns};
  for (Index k = 0; k < hard; ++k) {
    std::copy(rows[k].begin(), rows[k].end(), matrix[k].begin());
    all.b[k] = lower[k];
  }
  for (Index k = 0; k < count; ++k) {
    const Index soft = hard + k, alone = hard + count + k;
    double square = 1.0;
    for (const double x : a[k]) square += x * x;
    const double norm = std::sqrt(square);
    for (Index j = 0; j < free; ++j) matrix(soft, j) = a(k, j) / norm;
    matrix(soft, free + k) = 1.0 / norm, all.b[soft] = target[k] / norm;
    matrix(alone, free + k) = 1.0, all.b[alone] = least[k];
  }
  return all;
}

// Writes how steep the rows a (k, n) are, and how steep in the directions of a basis (n, r).
inline void steepness(Matrix<const double> a, Matrix<const double> basis, Vector<double> whole,
                      Vector<double> within) {
  for (Index k = 0; k < a.rows; ++k) {
    double free = 0.0;
    for (Index i = 0; i < basis.columns; ++i) {
      double along = 0.0;
      for (Index j = 0; j < a.columns; ++j) along += a(k, j) * basis(j, i);
      free += along * along;
    }
    whole[k] = norm(a[k]), within[k] = std::sqrt(free);
  }
}

// Writes which rows a u >= b (s,) u violates, rounding aside.
inline void violated(Matrix<const double> a, Vector<const double> b, Vector<const double> u,
                     Vector<bool> violates) {
  double largest = 0.0, total = 0.0;
  for (const double value : u) largest = std::max(largest, std::abs(value));
  const double allowed = tolerances::MET * (1.0 + largest);
  const auto lack = [&](Index k) { return b[k] - dot(a[k], u); };
  for (Index k = 0; k < b.size; ++k) {
    violates[k] = lack(k) > allowed * std::max(norm(a[k]), tolerances::ZERO_GRADIENT);
    if (violates[k]) total += lack(k) * lack(k);
  }
  for (Index k = 0; k < b.size; ++k)
    violates[k] = violates[k] && lack(k) > tolerances::NEGLIGIBLE * std::sqrt(total);
}

}  // namespace hcbf::dense
