// The outside of a disc, h = ‖p − c‖ − r. Source: section IV-A of the paper, h₃ and h₄.
#pragma once
#include <hcbf/planar_jet.hpp>

namespace hcbf::disc {

constexpr Index CODE = 1;
constexpr int CENTER_X = 2, CENTER_Y = 3, RADIUS = 4;  // [m]

inline Index write(double* c, const double* velocity, const double* center, double radius) {
  begin_block(c, velocity);
  c[CENTER_X] = center[0], c[CENTER_Y] = center[1];
  c[RADIUS] = radius;
  return CODE;
}

template <class Number>
inline PlanarJetOf<Number> jet(const Number* c, const Number& x, const Number& y) {
  PlanarJetOf<Number> at = point_jet<Number>(x - c[CENTER_X], y - c[CENTER_Y]);
  at.h -= c[RADIUS];
  return at;
}

// The core is the centre.
template <class Number>
inline CoreOf<Number> core(const Number* c, const Number&, const Number&, const Number&, const Number& distance,
                    const Number&) {
  return {distance, c[RADIUS], true};
}

inline Bounds bounds(const double* c) {
  const double x = c[CENTER_X], y = c[CENTER_Y], radius = c[RADIUS];
  return {x - radius, y - radius, x + radius, y + radius};
}

}  // namespace hcbf::disc
