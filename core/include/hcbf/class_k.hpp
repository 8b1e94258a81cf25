// Extended class-K functions α, and what rows are made by. α is strictly increasing, α(0) = 0, with
// derivative and inverse. There is a linear one, α(h) = gain h, the paper's (section IV-A), of slope
// φ₁φ₂ / (φ₂|h| + φ₃), and that of the braking distance, of slope a / √(2a|h| + c²):
//
//     α(h) = sign(h) φ₁ (log(φ₂|h| + φ₃) − log φ₃),     α(h) = sign(h) (√(2a|h| + c²) − c).
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include <hcbf/dual.hpp>

namespace hcbf {

namespace functions {

template <class To, class From>
inline To bits_as(const From& from) {
  static_assert(sizeof(To) == sizeof(From));
  To to;
  std::memcpy(&to, &from, sizeof to);
  return to;
}

// log(1 + x) of x ≥ 0 up to two units in the last place. It is inlined where rows are made, of which it is a
// quarter, and has the same bits on every machine.
//
// 1 + x = 2ᵏ (1 + f) with √½ ≤ 1 + f < √2, and with s = f / (2 + f)
//     log(1 + f) = f − f²/2 + s (f²/2 + R(s²)),   R from fdlibm, s_log1p.c (Sun Microsystems).
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

}  // namespace functions

template <int N>
Dual<N> log1p(const Dual<N>& a) {
  return Dual<N>::chain(functions::log1p(a.v), 1.0 / (1.0 + a.v), a);
}

}  // namespace hcbf

namespace hcbf::class_k {

constexpr double LINEAR = 0.0, LOG = 1.0, BRAKE = 2.0;

struct ClassK {  // as `ClassK.parameters` in Python packs it
  double kind;
  double scale;   // the gain of a linear function [1/s], φ₁ [m/s] or a [m/s²]
  double rate;    // φ₂ [1/m]
  double offset;  // φ₃, or c [m/s]
};

constexpr double GAIN = 10.0;  // of α₂ and of speed limits, where a robot moves as its model [1/s]

// The gain at a period T [s]: half of ψ is left after a hold.
inline double gain_at(double period, double gain = GAIN) { return std::min(gain, 0.5 / period); }

// α(h).
template <class Number>
inline Number value(const ClassK& c, const Number& h) {
  using namespace functions;
  if (c.kind == LINEAR) return c.scale * h;
  if (c.kind == BRAKE) return 2.0 * c.scale * h / (sqrt(2.0 * c.scale * abs(h) + c.offset * c.offset) + c.offset);
  return copysign(c.scale * log1p(c.rate / c.offset * abs(h)), h);
}

// dα/dh; it is largest at h = 0 and does not grow with |h|.
template <class Number>
inline Number slope(const ClassK& c, const Number& h) {
  using namespace functions;
  if (c.kind == LINEAR) return c.scale;
  if (c.kind == BRAKE) return c.scale / sqrt(2.0 * c.scale * abs(h) + c.offset * c.offset);
  return c.scale * c.rate / (c.rate * abs(h) + c.offset);
}

// α⁻¹(y).
inline double inverse(const ClassK& c, double y) {
  if (c.kind == LINEAR) return y / c.scale;
  if (c.kind == BRAKE) return y * (std::abs(y) + 2.0 * c.offset) / (2.0 * c.scale);
  return std::copysign(c.offset / c.rate * std::expm1(std::abs(y) / c.scale), y);
}

}  // namespace hcbf::class_k

namespace hcbf {

// How barriers become rows a·u ≥ b: α₁, α₂, and for how long an input is held. `RowSettings.packed` in Python
// has the same (19,) numbers.
struct RowSettings {
  class_k::ClassK alpha1, alpha2;
  class_k::ClassK alpha_speed;  // of speed limits and zones, on h itself
  double period;           // T [s]
  double u_max;            // the largest norm of an input [m/s²]; 0 where U is not known
  double held;             // 1 for rows of an input that is held for T, else 0
  double low[2], high[2];  // the least and the greatest inputs [m/s²]
};
static_assert(sizeof(RowSettings) == 19 * sizeof(double));

// How far a plant may be from its model: `models.plant.Uncertainty`, field by field.
struct Uncertainty {
  double distance;            // d [m]
  double per_velocity;        // k_v [s]
  double per_lead;            // k_p
  double cap;                 // the most that a tracking error takes [m]
  double confidence;          // kappa
  double body;                // rho, how far the body reaches [m]
  double speed;               // d_s [m/s]
  double speed_per_velocity;  // k_s
};

}  // namespace hcbf
