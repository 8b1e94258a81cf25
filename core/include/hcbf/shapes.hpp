// The built-in shapes: the signed distance H to each at a point of its own frame, and how a shape's functions
// are found by its kind. c is its block (WIDTH,), see `layout`. A new shape is a namespace with `CODE`, `write`,
// `jet`, `core` and `bounds`, and a line in each function at the end.
#pragma once
#include <algorithm>

#include <hcbf/dual.hpp>
#include <hcbf/layout.hpp>

namespace hcbf {

constexpr double INF = INFINITY;

// The signed distance H of a shape, so that ‖∇H‖ = 1, and its derivatives. The Hessian has rank one,
// ∇²H = t tᵀ / d: d is the distance from the centre of curvature (a disc's centre, a polygon's
// corner), and infinite where H is flat.
template <class Number>
struct PlanarJetOf {
  Number h;         // H [m]
  Number gx, gy;    // ∇H
  Number distance;  // d [m]
  Number tx, ty;    // t
};
using PlanarJet = PlanarJetOf<double>;

// The convex set from which a barrier is a distance, h = distance − radius, seen locally.
template <class Number>
struct CoreOf {
  Number distance;  // from the core [m]; infinite where ∇H does not turn within the reach
  Number radius;    // how far the region reaches beyond its core [m]
  bool is_point;    // whether the core is a point, from all of the reach
};
using Core = CoreOf<double>;

struct Bounds {  // of a region [m]; infinite with swapped signs where it has none
  double low_x, low_y, high_x, high_y;
};

constexpr double TINY = 1e-9;  // below this distance from a region's centre its gradient is along +x [m]

// ‖r‖ with its gradient, the distance ‖r‖ from the core, and the tangent.
template <class Number>
inline PlanarJetOf<Number> point_jet(const Number& x, const Number& y) {
  using namespace functions;
  const Number distance = sqrt(x * x + y * y);
  if (distance < TINY) return {distance, 1.0, 0.0, INF, 0.0, 1.0};
  const Number nx = x / distance, ny = y / distance;
  return {distance, nx, ny, distance, -ny, nx};
}

// Clears a block (WIDTH,) and writes its velocity.
inline void begin_block(double* c, const double* velocity) {
  for (int i = 0; i < layout::WIDTH; ++i) c[i] = 0.0;
  c[layout::VELOCITY_X] = velocity[0], c[layout::VELOCITY_Y] = velocity[1];
}

}  // namespace hcbf

// The allowed side of a straight wall, h = n·p − offset.
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

// The outside of a disc, h = ‖p − c‖ − r. Source: section IV-A of the paper, h₃ and h₄.
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

// The outside of an ellipse: h is the signed distance to it.
//
// With u along the longer and v along the shorter axis, the normal at the foot of (u, v) is along
// w = (u / (s + a² − b²), v / s), where s > 0 solves (a w_u)² + (b w_v)² = 1; then H = (s − b²) ‖w‖.
// The reciprocal root of the left side is nearly linear and concave in s, so that Newton's steps come
// from below and are few.
namespace hcbf::ellipse {

constexpr Index CODE = 2;
constexpr int CENTER_X = 2, CENTER_Y = 3;  // [m]
constexpr int COS = 4, SIN = 5;            // the direction of the longer semi-axis
constexpr int LONGER = 6, SHORTER = 7;     // semi-axes [m]

// How far from the longer axis a point is at least, so that its normal has a side [m].
constexpr double HAIR = 1e-13;
constexpr int MOST_STEPS = 20;  // Newton's, to the foot of a point; three to six are taken

inline Index write(double* c, const double* velocity, const double* center, const double* semi_axes,
                   double angle) {
  begin_block(c, velocity);
  c[CENTER_X] = center[0], c[CENTER_Y] = center[1];
  const double first = semi_axes[0], second = semi_axes[1], cos = std::cos(angle), sin = std::sin(angle);
  const bool turned = second > first;
  c[COS] = turned ? -sin : cos, c[SIN] = turned ? cos : sin;
  c[LONGER] = std::max(first, second), c[SHORTER] = std::min(first, second);
  return CODE;
}

template <class Number>
PlanarJetOf<Number> jet(const Number* c, const Number& x, const Number& y) {
  using namespace functions;
  const Number dx = x - c[CENTER_X], dy = y - c[CENTER_Y];
  const Number a = c[LONGER], b = c[SHORTER], cos = c[COS], sin = c[SIN];
  const Number along = cos * dx + sin * dy, across = cos * dy - sin * dx;
  const Number u = abs(along), v = abs(across) + HAIR;
  const Number apart = a * a - b * b;
  Number s = max(b * v, a * u - apart);
  for (int k = 0; k < MOST_STEPS; ++k) {
    const Number wu = u / (s + apart), wv = v / s;
    const Number first = a * a * wu * wu, second = b * b * wv * wv, size = first + second;
    const Number step = size * (sqrt(size) - 1.0) / (first / (s + apart) + second / s);
    s += step;
    if (!(step > 1e-15 * s)) break;
  }
  const Number wu = u / (s + apart), wv = v / s, norm = sqrt(wu * wu + wv * wv);
  const Number h = (s - b * b) * norm;
  Number distance = a * a * b * b * norm * norm * norm + h;  // the radius of curvature at the foot, and h
  const Number nu = copysign(wu / norm, along), nv = copysign(wv / norm, across);
  const Number nx = cos * nu - sin * nv, ny = sin * nu + cos * nv;
  if (distance < TINY) distance = INF;
  return {h, nx, ny, distance, -ny, nx};
}

// The core is what a disc of the smallest radius of curvature, b²/a, leaves inside.
template <class Number>
CoreOf<Number> core(const Number* c, const Number&, const Number&, const Number& h, const Number&,
                    const Number&) {
  const Number radius = c[SHORTER] * c[SHORTER] / c[LONGER];
  return {h + radius, radius, false};
}

// Of the circle around the ellipse.
inline Bounds bounds(const double* c) {
  const double x = c[CENTER_X], y = c[CENTER_Y], longer = c[LONGER];
  return {x - longer, y - longer, x + longer, y + longer};
}

}  // namespace hcbf::ellipse

// The outside of a convex polygon: h is the signed distance to it. Outside, h is continuously
// differentiable (its curvature jumps where the nearest point passes from an edge to a corner);
// inside, it is the depth below the nearest edge.
namespace hcbf::convex_polygon {

constexpr Index CODE = 3;
constexpr int COUNT = 2, FIRST = 3;                        // x and y of each corner from FIRST on [m]
constexpr int MAX_VERTICES = (layout::WIDTH - FIRST) / 2;  // most corners of a polygon
// Of fewer corners than that: what of its margin errors of measurement may use [m].
constexpr int USED = layout::WIDTH - 1;

inline Index write(double* c, const double* velocity, Matrix<const double> vertices) {
  begin_block(c, velocity);
  c[COUNT] = static_cast<double>(vertices.rows);
  for (Index i = 0; i < vertices.rows; ++i)
    c[FIRST + 2 * i] = vertices(i, 0), c[FIRST + 1 + 2 * i] = vertices(i, 1);
  return CODE;
}

// How many corners there are, within what a block can hold.
template <class Number>
int count(const Number* c) {
  return 1.0 <= c[COUNT] && c[COUNT] <= MAX_VERTICES ? static_cast<int>(value_of(c[COUNT])) : 1;
}

// What of its margin errors of measurement may use [m].
inline double used(const double* c) { return c[COUNT] < MAX_VERTICES ? c[USED] : 0.0; }

template <class Number>
struct Edge {
  Number ax, ay;  // where it starts [m]
  Number ex, ey;  // from there to its end [m]
};

template <class Number>
Edge<Number> edge(const Number* c, int i, int corners) {
  const int j = i + 1 < corners ? i + 1 : 0;
  const Number ax = c[FIRST + 2 * i], ay = c[FIRST + 1 + 2 * i];
  return {ax, ay, c[FIRST + 2 * j] - ax, c[FIRST + 1 + 2 * j] - ay};
}

template <class Number>
PlanarJetOf<Number> jet(const Number* c, const Number& x, const Number& y) {
  using namespace functions;
  const int corners = count(c);
  Number nearest2 = INF, offset_x = 0.0, offset_y = 0.0, edge_x = 0.0, edge_y = 0.0;
  bool outside = false, on_edge = false;
  for (int i = 0; i < corners; ++i) {
    const auto [ax, ay, ex, ey] = edge(c, i, corners);
    Number ox = x - ax, oy = y - ay;
    outside |= ey * ox - ex * oy > 0.0;
    const Number along = min(max((ox * ex + oy * ey) / (ex * ex + ey * ey), 0.0), 1.0);
    ox = ox - along * ex, oy = oy - along * ey;
    const Number distance2 = ox * ox + oy * oy;
    if (distance2 < nearest2) {
      nearest2 = distance2, offset_x = ox, offset_y = oy;
      on_edge = 0.0 < along && along < 1.0;
      edge_x = ex, edge_y = ey;
    }
  }
  const Number nearest = sqrt(nearest2);
  if (outside && !on_edge && nearest >= TINY) return point_jet(offset_x, offset_y);
  const Number length = sqrt(edge_x * edge_x + edge_y * edge_y);
  const Number nx = edge_y / length, ny = -edge_x / length;
  return {outside ? nearest : -nearest, nx, ny, INF, -ny, nx};
}

// Nothing is the core where one edge stays the nearest, else a corner, else the polygon. Inside, the
// nearest edge is taken for the region: no bound is known where it changes.
template <class Number>
CoreOf<Number> core(const Number* c, const Number& x, const Number& y, const Number& h, const Number&,
                    const Number& reach) {
  using namespace functions;
  if (h <= 0.0) return {INF, 0.0, false};
  const int corners = count(c);
  const Edge<Number> last = edge(c, corners - 1, corners);
  Number length = sqrt(last.ex * last.ex + last.ey * last.ey);
  // past the end of the edge before
  Number beyond = ((x - last.ax) * last.ex + (y - last.ay) * last.ey) / length - length;
  for (int i = 0; i < corners; ++i) {
    const auto [ax, ay, ex, ey] = edge(c, i, corners);
    length = sqrt(ex * ex + ey * ey);
    const Number along = ((x - ax) * ex + (y - ay) * ey) / length;
    const Number above = (ey * (x - ax) - ex * (y - ay)) / length;
    if (above > 0.0 && along >= reach && along <= length - reach) return {INF, 0.0, false};
    if (beyond >= reach && along <= -reach) return {h, 0.0, true};
    beyond = along - length;
  }
  return {h, 0.0, false};
}

inline Bounds bounds(const double* c) {
  Bounds box{INF, INF, -INF, -INF};
  for (int i = 0; i < count(c); ++i) {
    const double x = c[FIRST + 2 * i], y = c[FIRST + 1 + 2 * i];
    box = {std::min(box.low_x, x), std::min(box.low_y, y), std::max(box.high_x, x), std::max(box.high_y, y)};
  }
  return box;
}

}  // namespace hcbf::convex_polygon

// The outside of a capsule, all that is within a radius r of a segment from a to b:
// h = min over s in [0, 1] of ‖p − (1 − s) a − s b‖ − r, continuously differentiable but on the segment.
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

namespace hcbf::shapes {

template <class Number>
struct PlaceOf {
  Number x, y;
};
using Place = PlaceOf<double>;

// A point of the world (x, y) as the barrier's frame sees it at time t.
template <class Number>
PlaceOf<Number> in_frame(const Number* c, const Number& x, const Number& y, double t) {
  return {x - c[layout::VELOCITY_X] * t, y - c[layout::VELOCITY_Y] * t};
}

// H and its derivatives at a point of the shape's frame; H is infinite for what is no shape.
template <class Number>
inline PlanarJetOf<Number> jet(Index kind, const Number* c, const Number& x, const Number& y) {
  switch (kind) {
    case half_plane::CODE: return half_plane::jet(c, x, y);
    case disc::CODE: return disc::jet(c, x, y);
    case ellipse::CODE: return ellipse::jet(c, x, y);
    case convex_polygon::CODE: return convex_polygon::jet(c, x, y);
    case capsule::CODE: return capsule::jet(c, x, y);
  }
  return {INF, 0.0, 0.0, INF, 0.0, 0.0};
}

// The core of a shape seen from a point of its frame (x, y), where H and d are `h` and `distance` [m],
// by a robot that gets `reach` far in one period [m].
template <class Number>
inline CoreOf<Number> core(Index kind, const Number* c, const Number& x, const Number& y, const Number& h,
                    const Number& distance, const Number& reach) {
  switch (kind) {
    case half_plane::CODE: return half_plane::core(c, x, y, h, distance, reach);
    case disc::CODE: return disc::core(c, x, y, h, distance, reach);
    case ellipse::CODE: return ellipse::core(c, x, y, h, distance, reach);
    case convex_polygon::CODE: return convex_polygon::core(c, x, y, h, distance, reach);
    case capsule::CODE: return capsule::core(c, x, y, h, distance, reach);
  }
  return {INF, INF, false};
}

// Of a region at time 0 [m].
inline Bounds bounds(Index kind, const double* c) {
  switch (kind) {
    case disc::CODE: return disc::bounds(c);
    case ellipse::CODE: return ellipse::bounds(c);
    case convex_polygon::CODE: return convex_polygon::bounds(c);
    case capsule::CODE: return capsule::bounds(c);
  }
  return half_plane::bounds(c);
}

}  // namespace hcbf::shapes
