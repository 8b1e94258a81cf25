// Dual numbers v + d ε with ε² = 0: arithmetic on them carries N derivatives along (forward mode).
//
// What is templated on `class Number` is one text for numbers and for their derivatives. Comparisons
// read values, so that both take the same branches; at a kink the derivative is that of the branch
// taken, which is one-sided. √ and ‖·‖ have derivative 0 at 0. Source: Griewank and Walther,
// "Evaluating Derivatives", 2008.
#pragma once
#include <algorithm>
#include <cmath>

namespace hcbf {

// What templates on Number call unqualified: these for double, the friends below for duals.
namespace functions {
using std::abs, std::atan2, std::copysign, std::cos, std::hypot, std::isfinite, std::isinf;
using std::max, std::min, std::sin, std::sqrt;
}  // namespace functions

inline double value_of(double x) { return x; }

template <int N>
struct Dual {
  double v = 0.0, d[N] = {};

  Dual() = default;
  Dual(double value) : v(value) {}
  // The variable number i, whose own derivative is 1.
  static Dual variable(double value, int i) {
    Dual x(value);
    x.d[i] = 1.0;
    return x;
  }
  // value + p (a - a.v) + q (b - b.v): a function of a and b with the partial derivatives p and q.
  static Dual chain(double value, double p, const Dual& a, double q, const Dual& b) {
    Dual x(value);
    for (int i = 0; i < N; ++i) x.d[i] = p * a.d[i] + q * b.d[i];
    return x;
  }
  static Dual chain(double value, double p, const Dual& a) {
    Dual x(value);
    for (int i = 0; i < N; ++i) x.d[i] = p * a.d[i];
    return x;
  }

  Dual operator-() const { return chain(-v, -1.0, *this); }
  Dual& operator+=(const Dual& b) { return *this = *this + b; }
  Dual& operator-=(const Dual& b) { return *this = *this - b; }
  friend Dual operator+(const Dual& a, const Dual& b) { return chain(a.v + b.v, 1.0, a, 1.0, b); }
  friend Dual operator-(const Dual& a, const Dual& b) { return chain(a.v - b.v, 1.0, a, -1.0, b); }
  friend Dual operator*(const Dual& a, const Dual& b) { return chain(a.v * b.v, b.v, a, a.v, b); }
  friend Dual operator/(const Dual& a, const Dual& b) {
    const double ratio = a.v / b.v;
    return chain(ratio, 1.0 / b.v, a, -ratio / b.v, b);
  }
  // Constants have no derivatives to carry.
  friend Dual operator+(const Dual& a, double b) { return chain(a.v + b, 1.0, a); }
  friend Dual operator+(double a, const Dual& b) { return chain(a + b.v, 1.0, b); }
  friend Dual operator-(const Dual& a, double b) { return chain(a.v - b, 1.0, a); }
  friend Dual operator-(double a, const Dual& b) { return chain(a - b.v, -1.0, b); }
  friend Dual operator*(const Dual& a, double b) { return chain(a.v * b, b, a); }
  friend Dual operator*(double a, const Dual& b) { return chain(a * b.v, a, b); }
  friend Dual operator/(const Dual& a, double b) { return chain(a.v / b, 1.0 / b, a); }

  friend bool operator<(const Dual& a, const Dual& b) { return a.v < b.v; }
  friend bool operator>(const Dual& a, const Dual& b) { return a.v > b.v; }
  friend bool operator<=(const Dual& a, const Dual& b) { return a.v <= b.v; }
  friend bool operator>=(const Dual& a, const Dual& b) { return a.v >= b.v; }
  friend bool operator==(const Dual& a, const Dual& b) { return a.v == b.v; }
  friend bool operator!=(const Dual& a, const Dual& b) { return a.v != b.v; }

  friend Dual max(const Dual& a, const Dual& b) { return a.v < b.v ? b : a; }
  friend Dual min(const Dual& a, const Dual& b) { return b.v < a.v ? b : a; }
  friend Dual abs(const Dual& a) { return chain(std::abs(a.v), a.v < 0.0 ? -1.0 : 1.0, a); }
  friend Dual copysign(const Dual& a, const Dual& sign) {
    const double value = std::copysign(a.v, sign.v);
    return chain(value, std::signbit(value) == std::signbit(a.v) ? 1.0 : -1.0, a);
  }
  friend Dual sqrt(const Dual& a) {
    const double root = std::sqrt(a.v);
    return chain(root, root > 0.0 ? 0.5 / root : 0.0, a);
  }
  friend Dual hypot(const Dual& a, const Dual& b) {
    const double size = std::hypot(a.v, b.v);
    return size > 0.0 ? chain(size, a.v / size, a, b.v / size, b) : Dual(size);
  }
  friend Dual cos(const Dual& a) { return chain(std::cos(a.v), -std::sin(a.v), a); }
  friend Dual sin(const Dual& a) { return chain(std::sin(a.v), std::cos(a.v), a); }
  friend Dual atan2(const Dual& y, const Dual& x) {
    const double square = x.v * x.v + y.v * y.v;
    return chain(std::atan2(y.v, x.v), x.v / square, y, -y.v / square, x);
  }
  friend bool isfinite(const Dual& a) { return std::isfinite(a.v); }
  friend bool isinf(const Dual& a) { return std::isinf(a.v); }
};

template <int N>
double value_of(const Dual<N>& x) {
  return x.v;
}

// An argument from which a template does not deduce Number.
template <class T>
struct Undeduced {
  using type = T;
};
template <class T>
using Given = typename Undeduced<T>::type;

}  // namespace hcbf
