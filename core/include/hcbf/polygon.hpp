// Convex polygons as lists of corners: cut by a line, and searched for a minimum.
//
// Corners are in counter-clockwise order; two are a segment, one is a point. A polygon never becomes
// empty: a cut that would leave nothing leaves the face that violates the cut least, so that no
// rounding can make a stage infeasible.
#pragma once
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <hcbf/arrays.hpp>
#include <hcbf/tolerances.hpp>

namespace hcbf::polygon {

using std::abs, std::max, std::min;

struct Point {
  double x, y;
};

inline double dot(Point a, Point b) { return a.x * b.x + a.y * b.y; }

// The point that is t of the way from a to b.
inline Point between(Point a, Point b, double t) { return {a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)}; }

// The line n u = d with a unit normal; a cut keeps the side n u >= d.
struct Line {
  Point n;
  double d;
  double above(Point u) const { return dot(n, u) - d; }
  Line operator-() const { return {{-n.x, -n.y}, -d}; }
};

struct Polygon {
  std::vector<Point> corners;
  std::vector<Point> spare;  // for cuts, as much room as for corners

  void reserve(Index count) { corners.reserve(count), spare.reserve(count); }
  operator Vector<const Point>() const { return {corners.data(), static_cast<Index>(corners.size())}; }
  bool is_point() const { return corners.size() == 1; }
};

// Returns corners (V, 2) that NumPy holds, as points.
static_assert(sizeof(Point) == 2 * sizeof(double));
inline Vector<const Point> points(Matrix<const double> corners) {
  return {reinterpret_cast<const Point*>(corners.data), corners.rows};
}

struct Range {
  double low, high;
};

// Returns the least and the greatest n u on a polygon.
inline Range span(Vector<const Point> corners, Point n) {
  Range range{INFINITY, -INFINITY};
  for (const Point u : corners) {
    const double value = dot(n, u);
    range = {min(range.low, value), max(range.high, value)};
  }
  return range;
}

inline bool near(Point a, Point b, double distance) {
  return abs(a.x - b.x) <= distance && abs(a.y - b.y) <= distance;
}

// Keeps, of the corners with n u >= level, the two that are farthest apart.
inline void keep_face(Polygon& polygon, Point n, double level, double same) {
  double first = INFINITY, last = -INFINITY;
  Point right{}, left{};
  for (const Point u : polygon.corners) {
    if (!(dot(n, u) >= level)) continue;
    const double along = n.x * u.y - n.y * u.x;
    if (along < first) first = along, right = u;
    if (along > last) last = along, left = u;
  }
  polygon.corners.assign(1, right);
  if (last - first > same) polygon.corners.push_back(left);
}

// Cuts a polygon to n u >= d; to its face of greatest n u where that is empty. `radius` is the
// largest norm of an input. A line of NaN cuts nothing.
inline void cut(Polygon& polygon, const Line& line, double radius) {
  const double thin = tolerances::THIN * radius, same = tolerances::SAME_CORNER * radius;
  const auto [lowest, highest] = span(polygon, line.n);
  if (!(lowest < line.d)) return;
  if (highest <= line.d + thin)  // compared before d is subtracted, which may be huge
    return keep_face(polygon, line.n, highest - thin, same);
  std::vector<Point>& kept = polygon.spare;
  kept.clear();
  const auto keep = [&](Point u) {
    if (kept.empty() || !near(kept.back(), u, same)) kept.push_back(u);
  };
  Point from = polygon.corners.back();
  double before = line.above(from);
  for (const Point u : polygon.corners) {
    const double here = line.above(u);
    if ((here >= 0.0) != (before >= 0.0)) keep(between(from, u, before / (before - here)));
    if (here >= 0.0) keep(u);
    from = u, before = here;
  }
  while (kept.size() > 1 && near(kept.front(), kept.back(), same)) kept.pop_back();
  polygon.corners.swap(kept);
}

// Cuts a polygon to n u = d, a value that it attains.
inline void slice_at(Polygon& polygon, const Line& line, double radius) {
  cut(polygon, line, radius);
  cut(polygon, -line, radius);
}

// Returns whether a point is in a polygon of three corners or more, without any tolerance.
inline bool contains(Vector<const Point> corners, Point u) {
  Point from = corners[corners.size - 1];
  for (const Point to : corners) {
    if ((to.x - from.x) * (u.y - from.y) < (to.y - from.y) * (u.x - from.x)) return false;
    from = to;
  }
  return true;
}

// |R u - z|^2 with R = [[r11, r12], [0, r22]].
struct LeastSquares {
  double r11 = 0.0, r12 = 0.0, r22 = 0.0;
  Point z{0.0, 0.0};

  // w |u - centre|^2
  static LeastSquares distance(double weight, Point centre) {
    const double root = std::sqrt(weight);
    return {root, 0.0, root, {root * centre.x, root * centre.y}};
  }
  // Adds (a u - t)^2 by two Givens rotations: no square is formed.
  void add(double ax, double ay, double t) {
    if (ax != 0.0) {
      const double length = std::hypot(r11, ax), c = r11 / length, s = ax / length;
      const double above = r12, wanted = z.x;
      r11 = length;
      r12 = c * above + s * ay, ay = c * ay - s * above;
      z.x = c * wanted + s * t, t = c * t - s * wanted;
    }
    if (ay != 0.0) {
      const double length = std::hypot(r22, ay), c = r22 / length, s = ay / length;
      r22 = length;
      z.y = c * z.y + s * t;
    }
  }
  Point image(Point d) const { return {r11 * d.x + r12 * d.y, r22 * d.y}; }
  Point residual(Point u) const {
    const Point v = image(u);
    return {v.x - z.x, v.y - z.y};
  }
};

// Returns the minimiser over a polygon of a problem of full rank with its centre at `centre`.
//
// The point is chosen by the signs of the gradient, not by comparing costs, whose differences drown
// in rounding where the weights are large.
inline Point descend(Vector<const Point> corners, const LeastSquares& problem, Point centre) {
  const Index count = corners.size;
  if (count == 1) return corners[0];
  if (count > 2 && contains(corners, centre)) return centre;
  const auto side = [&](Index i, Index j) {
    return Point{corners[j].x - corners[i].x, corners[j].y - corners[i].y};
  };
  double least = INFINITY;
  Point best = corners[0];
  double arriving = dot(problem.image(side(count - 1, 0)), problem.residual(corners[0]));
  for (Index i = 0; i < count; ++i) {
    const Point along = side(i, i + 1 < count ? i + 1 : 0), step = problem.image(along);
    Point u = corners[i], e = problem.residual(u);
    const double leaving = dot(step, e);
    if (leaving >= 0.0 && arriving <= 0.0) return u;
    const double t = -leaving / dot(step, step);
    arriving = leaving + step.x * step.x + step.y * step.y;
    if (0.0 < t && t < 1.0) {
      u = {u.x + t * along.x, u.y + t * along.y}, e = problem.residual(u);
      const Point gradient{problem.r11 * e.x, problem.r12 * e.x + problem.r22 * e.y};
      if (-along.y * gradient.x + along.x * gradient.y >= 0.0 || count == 2) return u;  // it points inwards
    }
    if (const double cost = dot(e, e); cost < least) least = cost, best = u;
  }
  return best;
}

// Returns the point of a polygon that is nearest to u*.
inline Point nearest(Vector<const Point> corners, Point u_nominal) {
  return descend(corners, LeastSquares::distance(1.0, u_nominal), u_nominal);
}

// Returns the point of a polygon that minimises |R u - z|^2; of several, the nearest to u*.
// `chord` is written to.
inline Point minimise(const Polygon& polygon, const LeastSquares& problem, Point u_nominal, double radius,
                      Polygon& chord) {
  const auto& [r11, r12, r22, z] = problem;
  const double size = std::sqrt(r11 * r11 + r12 * r12 + r22 * r22);
  if (size <= tolerances::ZERO_GRADIENT) return nearest(polygon, u_nominal);
  if (abs(r11 * r22) > tolerances::RANK_ONE * size * size) {
    const double y = z.y / r22;
    return descend(polygon, problem, {(z.x - r12 * y) / r11, y});
  }
  // R = sigma p n': n u is decided, and u* decides the rest
  const double angle = 0.5 * std::atan2(2.0 * r11 * r12, r11 * r11 - r12 * r12 - r22 * r22);
  const Point n{std::cos(angle), std::sin(angle)}, p = problem.image(n);
  const auto [low, high] = span(polygon, n);
  const double target = min(max(dot(p, z) / dot(p, p), low), high);
  chord.corners = polygon.corners;
  slice_at(chord, {n, target}, radius);
  return nearest(chord, u_nominal);
}

}  // namespace hcbf::polygon
