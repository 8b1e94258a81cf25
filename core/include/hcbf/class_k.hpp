// Extended class-K functions α: strictly increasing, α(0) = 0, with derivative and inverse. There is a
// linear one, α(h) = gain h, and the paper's (section IV-A), of slope φ₁φ₂ / (φ₂|h| + φ₃):
//
//     α(h) = sign(h) φ₁ (log(φ₂|h| + φ₃) − log φ₃).
#pragma once
#include <hcbf/dual.hpp>

namespace hcbf::class_k {

constexpr double LINEAR = 0.0, LOG = 1.0;

struct ClassK {  // as `ClassK.parameters` in Python packs it
  double kind;
  double scale;   // the gain of a linear function [1/s], or φ₁ [m/s]
  double rate;    // φ₂ [1/m]
  double offset;  // φ₃
};

// α(h).
template <class Number>
inline Number value(const ClassK& c, const Number& h) {
  using namespace functions;
  if (c.kind == LINEAR) return c.scale * h;
  return copysign(c.scale * log1p(c.rate / c.offset * abs(h)), h);
}

// dα/dh; it is largest at h = 0 and does not grow with |h|.
template <class Number>
inline Number slope(const ClassK& c, const Number& h) {
  using namespace functions;
  if (c.kind == LINEAR) return c.scale;
  return c.scale * c.rate / (c.rate * abs(h) + c.offset);
}

// α⁻¹(y).
inline double inverse(const ClassK& c, double y) {
  if (c.kind == LINEAR) return y / c.scale;
  return std::copysign(c.offset / c.rate * std::expm1(std::abs(y) / c.scale), y);
}

}  // namespace hcbf::class_k
