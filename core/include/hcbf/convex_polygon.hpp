// The outside of a convex polygon: h is the signed distance to it. Outside, h is continuously
// differentiable (its curvature jumps where the nearest point passes from an edge to a corner);
// inside, it is the depth below the nearest edge.
#pragma once
#include <algorithm>

#include <hcbf/planar_jet.hpp>

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
