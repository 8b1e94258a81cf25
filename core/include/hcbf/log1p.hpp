// log(1 + x) of x ≥ 0 up to two units in the last place. It is inlined where rows are made, of which it is a
// quarter, and has the same bits on every machine.
//
// 1 + x = 2ᵏ (1 + f) with √½ ≤ 1 + f < √2, and with s = f / (2 + f)
//     log(1 + f) = f − f²/2 + s (f²/2 + R(s²)),   R from fdlibm, s_log1p.c (Sun Microsystems).
#pragma once
#include <cmath>
#include <cstdint>
#include <cstring>

namespace hcbf::functions {

template <class To, class From>
inline To bits_as(const From& from) {
  static_assert(sizeof(To) == sizeof(From));
  To to;
  std::memcpy(&to, &from, sizeof to);
  return to;
}

inline double log1p(double x) {
  constexpr std::uint64_t ONE = 0x3ff0000000000000, ROOT = 0x3fe6a09e667f3bcd;  // 1 and √½
  constexpr std::uint64_t FRACTION = 0x000fffffffffffff, WHOLE = 0x4330000000000000;  // 2⁵²
  if (!(x < INFINITY)) return x;
  const double sum = 1.0 + x, lost = x - (sum - 1.0);
  const std::uint64_t bits = bits_as<std::uint64_t>(sum) + (ONE - ROOT), exponent = bits >> 52;  // k + 1023
  const double k = bits_as<double>(exponent | WHOLE) - (bits_as<double>(WHOLE) + 1023.0);
  const double scale = bits_as<double>((2046 - exponent) << 52);  // 2⁻ᵏ
  const double f = bits_as<double>((bits & FRACTION) + ROOT) - 1.0 + lost * scale;
  const double s = f / (2.0 + f), z = s * s, w = z * z, half = 0.5 * f * f;
  const double high = 0.1818357216161805 + w * 0.14798198605116586;
  const double even = 0.6666666666666735 + w * (0.2857142874366239 + w * high);
  const double odd = 0.3999999999940942 + w * (0.22222198432149784 + w * 0.15313837699209373);
  const double rest = half - (s * (half + (z * even + w * odd)) + k * 1.9082149292705877e-10);
  return k * 0.6931471803691238 + (f - rest);
}

}  // namespace hcbf::functions
