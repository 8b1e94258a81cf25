// The point of a polyhedron that is nearest to a centre, argmin |x - c|^2 s.t. a x >= b.
//
// Goldfarb and Idnani's dual active-set method (1983) starts at the centre and adds the row that is
// missed most, dropping rows whose multipliers would change sign; every step raises the dual cost. The
// active rows are kept as Q R: Gram and Schmidt's orthogonal directions, made orthogonal twice.
#pragma once
#include <algorithm>
#include <cmath>
#include <vector>

#include <hcbf/arrays.hpp>
#include <hcbf/double_double.hpp>
#include <hcbf/tolerances.hpp>

namespace hcbf::projection {

using double_double::Double2;
using Size = std::size_t;

// What rounding leaves, relative to 1: of a row's value at x, and of a row that others span.
template <class Number>
struct Rounding;
template <>
struct Rounding<double> {
  static constexpr double VALUE = 2e-14, SPANNED = 1e-11;
};
template <>
struct Rounding<Double2> {
  static constexpr double VALUE = 1e-28, SPANNED = 1e-24;
};

// Returns the power of two next above a norm: rows divided by it lose no digit, and stay parallel.
inline double power_above(double norm) {
  int power;
  std::frexp(norm, &power);
  return std::ldexp(1.0, power);
}

enum class Outcome { FOUND, EMPTY, FAILED };

template <class Number>
class Projection {
 public:
  std::vector<Number> centre, a, b;  // (n,), (k, n) of norms near 1, (k,)
  std::vector<Number> x;             // the answer

  // Forgets all rows.
  void begin(Size n) {
    size = n;
    centre.assign(n, Number(0.0));
    a.clear(), b.clear();
  }

  // Adds a row a x >= b, scaled to a norm from 1/2 to 1; one of norm `least` or below is a constant.
  void add(const std::vector<Number>& row, const Number& bound, double least) {
    double square = 0.0;
    for (const Number& value : row) square += static_cast<double>(value) * static_cast<double>(value);
    if (!(std::sqrt(square) > least)) return;
    const Number factor(1.0 / power_above(std::sqrt(square)));
    for (const Number& value : row) a.push_back(value * factor);
    b.push_back(bound * factor);
  }

  // Writes x. `nonempty`: whether the set has a point by construction, so that a row that cannot be met
  // is left out, as rounding alone makes such.
  Outcome solve(bool nonempty) {
    left_out.assign(b.size(), false);
    Outcome outcome;
    while (!attempt(nonempty, outcome)) {}
    return outcome == Outcome::FOUND && !misses_little() ? Outcome::FAILED : outcome;
  }

  // Whether x is finite, and misses no row by more than rounding.
  bool misses_little() const {
    const double allowed = tolerances::PRIMAL * scale();
    for (Size k = 0; k < b.size(); ++k)
      if (!(lack(k) <= Number(allowed))) return false;
    return allowed < INFINITY;
  }

 private:
  Size size = 0;
  std::vector<Number> q, r;                    // orthonormal directions (n, n), and R by columns
  std::vector<Number> multiplier, effort, along, share;
  std::vector<Size> active;
  std::vector<char> left_out;

  Number dot(const Number* v, const Number* w) const {
    Number sum(0.0);
    for (Size i = 0; i < size; ++i) sum += v[i] * w[i];
    return sum;
  }
  Number lack(Size k) const { return b[k] - dot(&a[k * size], x.data()); }
  double scale() const {
    double largest = 0.0;
    for (const Number& value : x) largest = std::max(largest, std::abs(static_cast<double>(value)));
    return 1.0 + largest;
  }

  // One run of the method; false where a row was left out, and another run is needed.
  bool attempt(bool nonempty, Outcome& outcome) {
    x = centre;
    active.clear(), multiplier.clear();
    q.resize(size * size), r.resize(size * size), along.resize(size), share.resize(size);
    effort.resize(size);
    bool polished = true;  // whether x is what the active rows make it
    for (Size turn = 0; turn < 40 + 20 * b.size(); ++turn) {
      Size p = 0;
      Number most(Rounding<Number>::VALUE * scale());
      bool missed = false;
      for (Size k = 0; k < b.size(); ++k) {
        if (left_out[k] || std::find(active.begin(), active.end(), k) != active.end()) continue;
        const Number by = lack(k);
        if (by > most) most = by, p = k, missed = true;
      }
      if (!missed && polished) {
        outcome = Outcome::FOUND;
        return true;
      }
      if (!missed) {
        polish();
        polished = true;
        continue;
      }
      polished = false;
      if (meet(p)) continue;
      if (!nonempty && most > Number(tolerances::MISSED * scale())) {
        outcome = Outcome::EMPTY;
        return true;
      }
      left_out[p] = true;
      return false;
    }
    outcome = Outcome::FAILED;
    return true;
  }

  // Meets row p as well; false where the active rows leave it no way.
  bool meet(Size p) {
    using std::abs;
    const Number* row = &a[p * size];
    const Number norm2 = dot(row, row);
    Number push(0.0);
    for (Size round = 0; round <= 2 * size + 2; ++round) {
      const Size count = active.size();
      split(row);
      const Number gain = dot(along.data(), along.data());
      const bool spanned =
          count == size || gain <= Number(Rounding<Number>::SPANNED * Rounding<Number>::SPANNED) * norm2;
      Number largest(1.0);
      for (Size j = 0; j < count; ++j) largest = std::max(largest, abs(effort[j]));
      Size leaving = count;
      Number first(0.0);
      for (Size j = 0; j < count; ++j) {
        if (!(effort[j] > Number(Rounding<Number>::VALUE) * largest)) continue;
        const Number ratio = multiplier[j] / effort[j];
        if (leaving == count || ratio < first) first = ratio, leaving = j;
      }
      if (spanned && leaving == count) return false;
      const Number reach = spanned ? Number(0.0) : std::max(Number(0.0), lack(p) / gain);
      const bool full = !spanned && (leaving == count || reach <= first);
      const Number step = full ? reach : first;
      if (!spanned)
        for (Size i = 0; i < size; ++i) x[i] += step * along[i];
      for (Size j = 0; j < count; ++j) multiplier[j] -= step * effort[j];
      push += step;
      if (full) {
        append(p, gain, push);
        return true;
      }
      remove(leaving);
    }
    return false;
  }

  // Splits a row into its part that the active rows span, R effort, and the rest, `along`.
  void split(const Number* row) {
    const Size count = active.size();
    std::copy(row, row + size, along.begin());
    std::fill(share.begin(), share.end(), Number(0.0));
    for (int twice = 0; twice < 2; ++twice)
      for (Size j = 0; j < count; ++j) {
        const Number part = dot(&q[j * size], along.data());
        share[j] += part;
        for (Size i = 0; i < size; ++i) along[i] -= part * q[j * size + i];
      }
    for (Size j = count; j-- > 0;) {
      Number sum = share[j];
      for (Size i = j + 1; i < count; ++i) sum -= r[i * size + j] * effort[i];
      effort[j] = sum / r[j * size + j];
    }
  }

  void append(Size p, const Number& gain, const Number& push) {
    using std::sqrt;
    const Size count = active.size();
    const Number length = sqrt(gain);
    for (Size i = 0; i < size; ++i) q[count * size + i] = along[i] / length;
    for (Size i = 0; i < count; ++i) r[count * size + i] = share[i];
    r[count * size + count] = length;
    active.push_back(p), multiplier.push_back(push);
  }

  // Drops an active row: R loses a column, and rotations make it triangular again.
  void remove(Size leaving) {
    using std::sqrt;
    active.erase(active.begin() + leaving), multiplier.erase(multiplier.begin() + leaving);
    const Size count = active.size();
    for (Size j = leaving; j < count; ++j) std::copy_n(&r[(j + 1) * size], j + 2, &r[j * size]);
    for (Size j = leaving; j < count; ++j) {
      const Number above = r[j * size + j], below = r[j * size + j + 1];
      const Number length = sqrt(above * above + below * below);
      const Number cos = above / length, sin = below / length;
      const auto rotate = [&](Number& first, Number& second) {
        const Number kept = first;
        first = cos * kept + sin * second, second = cos * second - sin * kept;
      };
      for (Size i = j; i < count; ++i) rotate(r[i * size + j], r[i * size + j + 1]);
      for (Size i = 0; i < size; ++i) rotate(q[j * size + i], q[(j + 1) * size + i]);
    }
  }

  // Computes x afresh: the point of the active rows' bounds nearest to the centre.
  void polish() {
    x = centre;
    for (Size j = 0; j < active.size(); ++j) {
      Number sum = b[active[j]] - dot(&a[active[j] * size], centre.data());
      for (Size i = 0; i < j; ++i) sum -= r[j * size + i] * share[i];
      share[j] = sum / r[j * size + j];
    }
    for (Size j = 0; j < active.size(); ++j)
      for (Size i = 0; i < size; ++i) x[i] += share[j] * q[j * size + i];
  }
};

// Writes the x with a x >= b, rows of any length, that is nearest to x; returns whether there is one.
inline bool nearest_point(Matrix<const double> a, Vector<const double> b, std::vector<double>& x) {
  const auto solve = [&](auto& problem) {
    problem.begin(x.size());
    std::copy(x.begin(), x.end(), problem.centre.begin());
    for (Index k = 0; k < b.size; ++k)
      problem.add({a[k].begin(), a[k].end()}, b[k], tolerances::ZERO_GRADIENT);
    return problem.solve(false);
  };
  Projection<double> narrow;
  const Outcome outcome = solve(narrow);
  if (outcome == Outcome::FOUND) x = narrow.x;
  if (outcome != Outcome::FAILED) return outcome == Outcome::FOUND;
  Projection<Double2> wide;
  if (solve(wide) != Outcome::FOUND) return false;
  for (Size i = 0; i < x.size(); ++i) x[i] = static_cast<double>(wide.x[i]);
  return true;
}

}  // namespace hcbf::projection
