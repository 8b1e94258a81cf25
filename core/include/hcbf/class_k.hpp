// Extended class-K functions α: strictly increasing, α(0) = 0, with derivative and inverse. There is a
// linear one, α(h) = gain h, the paper's (section IV-A), of slope φ₁φ₂ / (φ₂|h| + φ₃), and that of the
// braking distance, of slope a / √(2a|h| + c²):
//
//     α(h) = sign(h) φ₁ (log(φ₂|h| + φ₃) − log φ₃),     α(h) = sign(h) (√(2a|h| + c²) − c).
#pragma once
#include <algorithm>

#include <hcbf/dual.hpp>

namespace hcbf::class_k {

constexpr double LINEAR = 0.0, LOG = 1.0, BRAKE = 2.0;

struct ClassK {  // as `ClassK.parameters` in Python packs it
  double kind;
  double scale;   // the gain of a linear function [1/s], φ₁ [m/s] or a [m/s²]
  double rate;    // φ₂ [1/m]
  double offset;  // φ₃, or c [m/s]
};

constexpr double GAIN = 10.0;  // of α₂ and of speed limits, where nothing else is given [1/s]

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
