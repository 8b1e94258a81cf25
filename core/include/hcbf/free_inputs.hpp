// A polyhedron in the directions that are still free, {u : u = point + F'z, a u >= b}, F orthonormal.
//
// A stage that pins a row takes a direction from F instead of adding an equality, so that no later stage
// can be infeasible through rounding.
#pragma once
#include <hcbf/projection.hpp>

namespace hcbf::free_inputs {

using Doubles = std::vector<double>;
using Gradient = Vector<const double>;

inline double dot(Gradient v, const double* w) {
  double sum = 0.0;
  for (Index i = 0; i < v.size; ++i) sum += v[i] * w[i];
  return sum;
}
inline double norm_of(Gradient v) { return std::sqrt(dot(v, v.data)); }

struct FreeInputs {
  Index n, free;              // how many inputs, and free directions
  Doubles point, directions;  // (n,), (free, n)
  Doubles a, b;               // (k, n) of norms from 1/2 to 1, (k,)
  Doubles known;              // the member nearest u*, where it is known already

  // All inputs with a u >= b, unit rows.
  FreeInputs(Matrix<const double> rows, Gradient bounds)
      : n(rows.columns), free(n), point(n, 0.0), directions(n * n, 0.0) {
    for (Index i = 0; i < n; ++i) directions[i * n + i] = 1.0;
    for (Index k = 0; k < bounds.size; ++k) keep(rows[k], 1.0, bounds[k]);
  }

  Index count() const { return b.size(); }
  Gradient row(Index k) const { return {a.data() + k * n, n}; }
  Gradient direction(Index j) const { return {directions.data() + j * n, n}; }

  // Adds a row, which it scales; a constant is left out.
  void keep(Gradient gradient, double norm, double bound) {
    if (!(norm > tolerances::ZERO_GRADIENT)) return;
    const double divisor = projection::power_above(norm);
    for (const double x : gradient) a.push_back(x / divisor);
    b.push_back(bound / divisor);
    known.clear();
  }

  // Returns a row as it acts on z.
  Doubles along(Gradient gradient) const {
    Doubles z(free);
    for (Index j = 0; j < free; ++j) z[j] = dot(direction(j), gradient.data);
    return z;
  }
  double slope(Gradient gradient) const {
    const Doubles z = along(gradient);
    return norm_of({z.data(), free});
  }

  // Keeps the inputs on which rows have their value at u, one of them: rounding must not take it out, so
  // no bound stays above its value at u. The next row to be pinned is the one with most of its freedom left.
  void pin(const std::vector<Gradient>& rows, const Doubles& u) {
    for (Index k = 0; k < count(); ++k) b[k] = std::min(b[k], dot(row(k), u.data()));
    known.clear();
    Doubles before(rows.size());
    for (std::size_t k = 0; k < rows.size(); ++k) before[k] = slope(rows[k]);
    while (free > 0) {
      double most = tolerances::DEPENDENT;
      Index next = -1;
      for (std::size_t k = 0; k < rows.size(); ++k) {
        if (!(before[k] > tolerances::DEPENDENT * norm_of(rows[k]))) continue;
        const double left = slope(rows[k]) / before[k];
        if (left > most) most = left, next = k;
      }
      if (next < 0) return;
      drop(along(rows[next]));
      point = u;
    }
  }

 private:
  // Takes a direction z from the free ones: Householder's reflection makes it the first.
  void drop(Doubles z) {
    const double length = norm_of({z.data(), free});
    z[0] += z[0] < 0.0 ? -length : length;
    const double square = dot({z.data(), free}, z.data());
    for (Index i = 0; i < n; ++i) {
      double sum = 0.0;
      for (Index j = 0; j < free; ++j) sum += z[j] * directions[j * n + i];
      for (Index j = 0; j < free; ++j) directions[j * n + i] -= 2.0 * sum / square * z[j];
    }
    directions.erase(directions.begin(), directions.begin() + n);
    --free;
  }
};

}  // namespace hcbf::free_inputs
