// Numbers with twice the digits of a double: the unevaluated sum of two, after Dekker (1971) and Knuth.
#pragma once
#include <cmath>

namespace hcbf::double_double {

struct Double2 {
  double high = 0.0, low = 0.0;

  Double2() = default;
  Double2(double x) : high(x) {}
  Double2(double x, double rest) : high(x + rest), low(rest - (high - x)) {}  // |x| >= |rest|, or x is 0
  explicit operator double() const { return high; }
  Double2 operator-() const { return {-high, -low}; }
};

// Returns a + b and its rounding error.
inline Double2 exact_sum(double a, double b) {
  const double sum = a + b, part = sum - a;
  Double2 both;
  both.high = sum, both.low = (a - (sum - part)) + (b - part);
  return both;
}

inline Double2 operator+(Double2 a, Double2 b) {
  const Double2 high = exact_sum(a.high, b.high), low = exact_sum(a.low, b.low);
  const Double2 sum{high.high, high.low + low.high};
  return {sum.high, sum.low + low.low};
}
inline Double2 operator*(Double2 a, Double2 b) {
  const double product = a.high * b.high;
  return {product, std::fma(a.high, b.high, -product) + (a.high * b.low + a.low * b.high)};
}
inline Double2 operator-(Double2 a, Double2 b) { return a + -b; }
inline Double2 operator/(Double2 a, Double2 b) {
  const double first = a.high / b.high;
  const Double2 rest = a - b * first;
  const double second = rest.high / b.high;
  return Double2{first, second} + (rest - b * second).high / b.high;
}
inline Double2& operator+=(Double2& a, Double2 b) { return a = a + b; }
inline Double2& operator-=(Double2& a, Double2 b) { return a = a - b; }

inline bool operator<(Double2 a, Double2 b) {
  return a.high < b.high || (a.high == b.high && a.low < b.low);
}
inline bool operator>(Double2 a, Double2 b) { return b < a; }
inline bool operator<=(Double2 a, Double2 b) { return a < b || (a.high == b.high && a.low == b.low); }

inline Double2 sqrt(Double2 a) {
  if (!(a.high > 0.0)) return 0.0;
  const double root = std::sqrt(a.high);
  return Double2{root} + (a - Double2{root} * root).high / (2.0 * root);
}
inline Double2 abs(Double2 a) { return a.high < 0.0 ? -a : a; }

}  // namespace hcbf::double_double
