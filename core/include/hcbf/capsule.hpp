// The outside of a capsule, all that is within a radius r of a segment from a to b:
// h = min over s in [0, 1] of ‖p − (1 − s) a − s b‖ − r, continuously differentiable but on the segment.
#pragma once
#include <algorithm>

#include <hcbf/planar_jet.hpp>

namespace hcbf::capsule {

constexpr Index CODE = 4;
constexpr int START_X = 2, START_Y = 3;              // [m]
constexpr int ALONG_X = 4, ALONG_Y = 5, LENGTH = 6;  // the unit vector along the segment, and its length [m]
constexpr int RADIUS = 7;                            // [m]

inline Index write(double* c, const double* velocity, const double* start, const double* end, double radius) {
  begin_block(c, velocity);
  c[START_X] = start[0], c[START_Y] = start[1];
  const double ex = end[0] - start[0], ey = end[1] - start[1], length = std::sqrt(ex * ex + ey * ey);
  c[ALONG_X] = ex / length, c[ALONG_Y] = ey / length, c[LENGTH] = length;
  c[RADIUS] = radius;
  return CODE;
}

template <class Number>
PlanarJetOf<Number> jet(const Number* c, const Number& x, const Number& y) {
  using namespace functions;
  const Number dx = x - c[START_X], dy = y - c[START_Y], ax = c[ALONG_X], ay = c[ALONG_Y];
  const Number along = ax * dx + ay * dy;
  if (0.0 < along && along < c[LENGTH]) {
    const Number across = ax * dy - ay * dx;
    const double side = across >= 0.0 ? 1.0 : -1.0;
    return {side * across - c[RADIUS], -side * ay, side * ax, INF, ax, ay};
  }
  const Number end = min(max(along, 0.0), c[LENGTH]);
  PlanarJetOf<Number> at = point_jet<Number>(dx - end * ax, dy - end * ay);
  at.h -= c[RADIUS];
  return at;
}

// An end is the core where it stays the nearest, none beside a side, else the segment. Beside a side
// ∇H does not turn: outside, the robot is kept from crossing the segment; inside, it must be too far
// from the segment to cross it.
template <class Number>
CoreOf<Number> core(const Number* c, const Number& x, const Number& y, const Number& h, const Number&,
                    const Number& reach) {
  const Number along = c[ALONG_X] * (x - c[START_X]) + c[ALONG_Y] * (y - c[START_Y]);
  const Number radius = c[RADIUS], away = h + radius;
  if (along <= -reach || along >= c[LENGTH] + reach) return {away, radius, true};
  const bool beside = reach <= along && along <= c[LENGTH] - reach;
  if (beside && (h > 0.0 || away >= reach)) return {INF, radius, false};
  return {away, radius, false};
}

inline Bounds bounds(const double* c) {
  const double x = c[START_X], y = c[START_Y], radius = c[RADIUS];
  const double ex = x + c[LENGTH] * c[ALONG_X], ey = y + c[LENGTH] * c[ALONG_Y];
  return {std::min(x, ex) - radius, std::min(y, ey) - radius, std::max(x, ex) + radius,
          std::max(y, ey) + radius};
}

}  // namespace hcbf::capsule
