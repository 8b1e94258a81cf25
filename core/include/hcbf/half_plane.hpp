// The allowed side of a straight wall, h = n·p − offset.
#pragma once
#include <hcbf/planar_jet.hpp>

namespace hcbf::half_plane {

constexpr Index CODE = 0;
constexpr int NORMAL_X = 2, NORMAL_Y = 3, OFFSET = 4;

inline Index write(double* c, const double* normal, double offset) {
  const double rest[2] = {0.0, 0.0};
  begin_block(c, rest);
  c[NORMAL_X] = normal[0], c[NORMAL_Y] = normal[1];
  c[OFFSET] = offset;
  return CODE;
}

template <class Number>
PlanarJetOf<Number> jet(const Number* c, const Number& x, const Number& y) {
  const Number nx = c[NORMAL_X], ny = c[NORMAL_Y];
  return {nx * x + ny * y - c[OFFSET], nx, ny, INF, -ny, nx};
}

// A core infinitely far away: ∇H never turns.
template <class Number>
CoreOf<Number> core(const Number*, const Number&, const Number&, const Number&, const Number&,
                    const Number&) {
  return {INF, INF, false};
}

inline Bounds bounds(const double*) { return {INF, INF, -INF, -INF}; }

}  // namespace hcbf::half_plane
