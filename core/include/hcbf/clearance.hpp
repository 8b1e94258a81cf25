// Whether h ≥ m holds over an interval in which the input and a region's velocity are constant.
//
// In the region's frame p(τ) = p + rτ + ½uτ², and m(τ) = m + sτ. Of a half-plane h − m is quadratic, and
// its least value is known. Of a disc ‖p(τ) − c‖² − (R + m(τ))² is a quartic, whose sign Bernstein's
// coefficients decide: it has no root where none of them is negative, and is halved elsewhere. Every other
// h is convex, thus above its tangent at the middle, which is quadratic: the interval is halved until that
// tangent clears m, h does not, or less than `FINE` of the path is left: what has more than that in reserve
// passes, wherever its intervals begin.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/constants.hpp>
#include <hcbf/shapes.hpp>

namespace hcbf::clearance {

constexpr double FINE = 1e-6;   // of a path on which a reserve is not looked for any further [m]
constexpr int HALVINGS = 40;    // of an interval at most

// A path in the frame of a region, and what is reserved along it.
struct Path {
  double x, y, rx, ry, ux, uy;  // position [m], velocity [m/s] and input [m/s²]
  double span;                  // [s]
  double margin, grows;         // m [m] at its start and s [m/s]
};

// The part of a path from a time on.
inline Path part(const Path& p, double from, double span) {
  return {p.x + (p.rx + 0.5 * p.ux * from) * from, p.y + (p.ry + 0.5 * p.uy * from) * from,
          p.rx + p.ux * from, p.ry + p.uy * from, p.ux, p.uy, span, p.margin + p.grows * from, p.grows};
}

// The least value of a + bτ + cτ² on [0, span].
inline double least(double a, double b, double c, double span) {
  const double end = a + (b + c * span) * span, turn = -0.5 * b;
  return c > 0.0 && turn > 0.0 && turn < c * span ? a - turn * turn / c : std::min(a, end);
}

// Whether a quartic on [0, 1] is nowhere negative, by Bernstein's coefficients; where the least value is
// zero up to rounding, it counts as negative.
inline bool is_positive(const double* b, int halvings) {
  if (!(b[0] >= 0.0 && b[4] >= 0.0)) return false;
  if (b[1] >= 0.0 && b[2] >= 0.0 && b[3] >= 0.0) return true;
  if (halvings == 0) return false;
  double left[5], right[5];
  double row[5] = {b[0], b[1], b[2], b[3], b[4]};
  for (int level = 0; level < 5; ++level) {
    left[level] = row[0], right[4 - level] = row[4 - level];
    for (int j = 0; j < 4 - level; ++j) row[j] = 0.5 * (row[j] + row[j + 1]);
  }
  return is_positive(left, halvings - 1) && is_positive(right, halvings - 1);
}

inline bool of_half_plane(const double* c, const Path& p) {
  const double nx = c[HalfPlane::NORMAL_X], ny = c[HalfPlane::NORMAL_Y];
  const double kept = nx * p.x + ny * p.y - c[HalfPlane::OFFSET] - p.margin;
  return least(kept, nx * p.rx + ny * p.ry - p.grows, 0.5 * (nx * p.ux + ny * p.uy), p.span) >= 0.0;
}

inline bool of_disc(const double* c, const Path& p) {
  const double x = p.x - c[Disc::CENTER_X], y = p.y - c[Disc::CENTER_Y], t = p.span;
  const double reach = c[Disc::RADIUS] + p.margin, sx = p.rx * t, sy = p.ry * t;
  const double hx = 0.5 * p.ux * t * t, hy = 0.5 * p.uy * t * t, grows = p.grows * t;
  const double a0 = x * x + y * y - reach * reach;
  const double a1 = 2.0 * (x * sx + y * sy - reach * grows);
  const double a2 = sx * sx + sy * sy + 2.0 * (x * hx + y * hy) - grows * grows;
  const double a3 = 2.0 * (sx * hx + sy * hy), a4 = hx * hx + hy * hy;
  const double b[5] = {a0, a0 + 0.25 * a1, a0 + 0.5 * a1 + a2 / 6.0, a0 + 0.75 * a1 + 0.5 * a2 + 0.25 * a3,
                       a0 + a1 + a2 + a3 + a4};
  return is_positive(b, HALVINGS);
}

inline bool of_convex(Index kind, const double* c, const Path& p, int halvings) {
  const double half = 0.5 * p.span;
  const Path middle = part(p, half, half);
  const PlanarJet at = shapes::jet(kind, c, middle.x, middle.y);
  const double kept = at.h - middle.margin;
  if (!(kept >= 0.0)) return false;
  // the tangent, from the start on
  const double rate = at.gx * p.rx + at.gy * p.ry, bend = 0.5 * (at.gx * p.ux + at.gy * p.uy);
  const double start = at.h + at.gx * (p.x - middle.x) + at.gy * (p.y - middle.y) - p.margin;
  if (least(start, rate - p.grows, bend, p.span) >= 0.0) return true;
  const double speed = std::max(std::hypot(p.rx, p.ry), std::hypot(p.rx + p.ux * p.span, p.ry + p.uy * p.span));
  if (speed * p.span < FINE || halvings == 0) return false;
  Path first = p;
  first.span = half;
  return of_convex(kind, c, first, halvings - 1) && of_convex(kind, c, middle, halvings - 1);
}

// Whether h ≥ m holds along a path.
inline bool holds(Index kind, const double* c, const Path& p) {
  if (kind == HalfPlane::CODE) return of_half_plane(c, p);
  if (kind == Disc::CODE) return of_disc(c, p);
  return of_convex(kind, c, p, HALVINGS);
}

// After which time a region that moves on has passed a place that rests [s]. `p`: the place in its frame.
inline double passed(Index kind, const double* c, const Path& p) {
  const double speed = std::hypot(p.rx, p.ry);
  if (speed == 0.0) return 0.0;
  if (kind == HalfPlane::CODE) return 4.0 * constants::FARTHEST / speed;
  const Bounds box = shapes::bounds(kind, c);
  const double away = std::hypot(p.x - 0.5 * (box.low_x + box.high_x), p.y - 0.5 * (box.low_y + box.high_y));
  const double size = 0.5 * std::hypot(box.high_x - box.low_x, box.high_y - box.low_y);
  return (away + size + p.margin) / speed;
}

}  // namespace hcbf::clearance
