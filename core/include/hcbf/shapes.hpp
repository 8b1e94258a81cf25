// The built-in shapes, and how one is found by its kind. c is its block (WIDTH,), see `layout`. A new shape is a
// struct such as `Disc` and a place in the list at the end. Long jets are not inlined: they would slow the others.
#pragma once
#include <algorithm>

#include <hcbf/dual.hpp>
#include <hcbf/ellipse.hpp>
#include <hcbf/layout.hpp>
#include <hcbf/planar_jet.hpp>

namespace hcbf {

// ‖r‖ with its gradient, the distance ‖r‖ from the core, and the tangent.
template <class Number>
inline PlanarJetOf<Number> point_jet(const Number& x, const Number& y) {
  using namespace functions;
  const Number distance = sqrt(x * x + y * y);
  if (distance < TINY) return {distance, 1.0, 0.0, INF, 0.0, 1.0};
  const Number nx = x / distance, ny = y / distance;
  return {distance, nx, ny, distance, -ny, nx};
}

// The allowed side of a straight wall, h = n·p − offset.
struct HalfPlane {
  static constexpr Index CODE = 0;
  static constexpr const char* KIND = "half-plane";
  static constexpr int NORMAL_X = 2, NORMAL_Y = 3, OFFSET = 4;

  static Index write(double* c, const Pair& normal, double offset) {
    begin_block(c, {0.0, 0.0});
    c[NORMAL_X] = normal[0], c[NORMAL_Y] = normal[1];
    c[OFFSET] = offset;
    return CODE;
  }

  template <class Number>
  static PlanarJetOf<Number> jet(const Number* c, const Number& x, const Number& y) {
    const Number nx = c[NORMAL_X], ny = c[NORMAL_Y];
    return {nx * x + ny * y - c[OFFSET], nx, ny, INF, -ny, nx};
  }

  // A core infinitely far away: ∇H never turns.
  template <class Number>
  static CoreOf<Number> core(const Number*, const Number&, const Number&,
                             const PlanarJetOf<Number>&, const Number&) {
    return {INF, INF, false};
  }

  static Bounds bounds(const double*) { return {}; }
};

// The outside of a disc, h = ‖p − c‖ − r. Source: section IV-A of the paper, h₃ and h₄.
struct Disc {
  static constexpr Index CODE = 1;
  static constexpr const char* KIND = "disc";
  static constexpr int CENTER_X = 2, CENTER_Y = 3, RADIUS = 4;  // [m]

  static Index write(double* c, const Pair& velocity, const Pair& center, double radius) {
    begin_block(c, velocity);
    c[CENTER_X] = center[0], c[CENTER_Y] = center[1];
    c[RADIUS] = radius;
    return CODE;
  }

  template <class Number>
  static PlanarJetOf<Number> jet(const Number* c, const Number& x, const Number& y) {
    PlanarJetOf<Number> at = point_jet<Number>(x - c[CENTER_X], y - c[CENTER_Y]);
    at.h -= c[RADIUS];
    return at;
  }

  // The core is the centre.
  template <class Number>
  static CoreOf<Number> core(const Number* c, const Number&, const Number&,
                             const PlanarJetOf<Number>& at, const Number&) {
    return {at.distance, c[RADIUS], true};
  }

  static Bounds bounds(const double* c) {
    const double x = c[CENTER_X], y = c[CENTER_Y], radius = c[RADIUS];
    return {x - radius, y - radius, x + radius, y + radius};
  }
};

// The outside of a convex polygon: h is the signed distance to it. Outside, h is continuously
// differentiable (its curvature jumps where the nearest point passes from an edge to a corner);
// inside, it is the depth below the nearest edge.
struct ConvexPolygon {
  static constexpr Index CODE = 3;
  static constexpr const char* KIND = "convex-polygon";
  static constexpr int COUNT = 2, FIRST = 3;                        // x and y of each corner from FIRST on [m]
  static constexpr int MAX_VERTICES = (layout::WIDTH - FIRST) / 2;  // most corners of a polygon
  // Of fewer corners than that: what of its margin errors of measurement may use [m].
  static constexpr int USED = layout::WIDTH - 1;

  static Index write(double* c, const Pair& velocity, Matrix<const double> vertices) {
    begin_block(c, velocity);
    c[COUNT] = static_cast<double>(vertices.rows);
    for (Index i = 0; i < vertices.rows; ++i)
      c[FIRST + 2 * i] = vertices(i, 0), c[FIRST + 1 + 2 * i] = vertices(i, 1);
    return CODE;
  }

  // How many corners there are, within what a block can hold.
  template <class Number>
  static int count(const Number* c) {
    return 1.0 <= c[COUNT] && c[COUNT] <= MAX_VERTICES ? static_cast<int>(value_of(c[COUNT])) : 1;
  }

  // What of its margin errors of measurement may use [m].
  static double used(const double* c) { return c[COUNT] < MAX_VERTICES ? c[USED] : 0.0; }

  template <class Number>
  struct Edge {
    Number ax, ay;  // where it starts [m]
    Number ex, ey;  // from there to its end [m]
  };

  template <class Number>
  static Edge<Number> edge(const Number* c, int i, int corners) {
    const int j = i + 1 < corners ? i + 1 : 0;
    const Number ax = c[FIRST + 2 * i], ay = c[FIRST + 1 + 2 * i];
    return {ax, ay, c[FIRST + 2 * j] - ax, c[FIRST + 1 + 2 * j] - ay};
  }

  template <class Number>
  [[gnu::noinline]] static PlanarJetOf<Number> jet(const Number* c, const Number& x, const Number& y) {
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
  static CoreOf<Number> core(const Number* c, const Number& x, const Number& y,
                             const PlanarJetOf<Number>& at, const Number& reach) {
    using namespace functions;
    if (at.h <= 0.0) return {INF, 0.0, false};
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
      if (beyond >= reach && along <= -reach) return {at.h, 0.0, true};
      beyond = along - length;
    }
    return {at.h, 0.0, false};
  }

  static Bounds bounds(const double* c) {
    Bounds box;
    for (int i = 0; i < count(c); ++i) {
      const double x = c[FIRST + 2 * i], y = c[FIRST + 1 + 2 * i];
      box = {std::min(box.low_x, x), std::min(box.low_y, y), std::max(box.high_x, x), std::max(box.high_y, y)};
    }
    return box;
  }
};

// The outside of a capsule, all that is within a radius r of a segment from a to b:
// h = min over s in [0, 1] of ‖p − (1 − s) a − s b‖ − r, continuously differentiable but on the segment.
struct Capsule {
  static constexpr Index CODE = 4;
  static constexpr const char* KIND = "capsule";
  static constexpr int START_X = 2, START_Y = 3;              // [m]
  static constexpr int ALONG_X = 4, ALONG_Y = 5, LENGTH = 6;  // the unit vector along the segment, and its length [m]
  static constexpr int RADIUS = 7;                            // [m]

  static Index write(double* c, const Pair& velocity, const Pair& start, const Pair& end, double radius) {
    begin_block(c, velocity);
    c[START_X] = start[0], c[START_Y] = start[1];
    const double ex = end[0] - start[0], ey = end[1] - start[1], length = std::sqrt(ex * ex + ey * ey);
    c[ALONG_X] = ex / length, c[ALONG_Y] = ey / length, c[LENGTH] = length;
    c[RADIUS] = radius;
    return CODE;
  }

  template <class Number>
  [[gnu::noinline]] static PlanarJetOf<Number> jet(const Number* c, const Number& x, const Number& y) {
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
  static CoreOf<Number> core(const Number* c, const Number& x, const Number& y,
                             const PlanarJetOf<Number>& at, const Number& reach) {
    const Number along = c[ALONG_X] * (x - c[START_X]) + c[ALONG_Y] * (y - c[START_Y]);
    const Number radius = c[RADIUS], away = at.h + radius;
    if (along <= -reach || along >= c[LENGTH] + reach) return {away, radius, true};
    const bool beside = reach <= along && along <= c[LENGTH] - reach;
    if (beside && (at.h > 0.0 || away >= reach)) return {INF, radius, false};
    return {away, radius, false};
  }

  static Bounds bounds(const double* c) {
    const double x = c[START_X], y = c[START_Y], radius = c[RADIUS];
    const double ex = x + c[LENGTH] * c[ALONG_X], ey = y + c[LENGTH] * c[ALONG_Y];
    return {std::min(x, ex) - radius, std::min(y, ey) - radius, std::max(x, ex) + radius,
            std::max(y, ey) + radius};
  }
};

// What is no shape: like a wall, infinitely far.
struct None : HalfPlane {
  template <class Number>
  static PlanarJetOf<Number> jet(const Number*, const Number&, const Number&) {
    return {INF, 0.0, 0.0, INF, 0.0, 0.0};
  }
};

// Calls a function with the shape whose kind is given.
template <class... Shapes>
struct List {
  template <class Function>
  static auto visit(Index, const Function& function) { return function(None{}); }
};
template <class First, class... Rest>
struct List<First, Rest...> {
  template <class Function>
  static auto visit(Index kind, const Function& function) {
    return kind == First::CODE ? function(First{}) : List<Rest...>::visit(kind, function);
  }
};

}  // namespace hcbf

namespace hcbf::shapes {

using All = List<HalfPlane, Disc, Ellipse, ConvexPolygon, Capsule>;

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
  return All::visit(kind, [&](auto shape) { return shape.jet(c, x, y); });
}

// The core of a shape seen from a point of its frame (x, y), `at` its jet there, by a robot that gets `reach`
// far in one period [m].
template <class Number>
inline CoreOf<Number> core(Index kind, const Number* c, const Number& x, const Number& y,
                           PlanarJetOf<Number> at, const Number& reach) {
  return All::visit(kind, [&](auto shape) { return shape.core(c, x, y, at, reach); });
}

// Of a region at time 0 [m].
inline Bounds bounds(Index kind, const double* c) {
  return All::visit(kind, [&](auto shape) { return shape.bounds(c); });
}

}  // namespace hcbf::shapes
