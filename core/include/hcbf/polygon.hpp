// Convex polygons as lists of corners: cut by a line, and searched for a minimum.
//
// Corners are in counter-clockwise order; two are a segment, one is a point. A polygon never becomes
// empty: a cut that would leave nothing leaves the face that violates the cut least, so that no
// rounding can make a stage infeasible.
#pragma once
#include <algorithm>
#include <limits>
#include <vector>

#include <hcbf/arrays.hpp>
#include <hcbf/dual.hpp>
#include <hcbf/tolerances.hpp>

namespace hcbf::polygon {

using namespace functions;

template <class Number>
struct PointOf {
  Number x, y;
};
using Point = PointOf<double>;

template <class Number>
Number dot(const PointOf<Number>& a, const PointOf<Number>& b) { return a.x * b.x + a.y * b.y; }

// The point that is t of the way from a to b.
template <class Number>
PointOf<Number> between(const PointOf<Number>& a, const PointOf<Number>& b, const Number& t) {
  return {a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)};
}

// The line n u = d with a unit normal; a cut keeps the side n u >= d.
template <class Number>
struct LineOf {
  PointOf<Number> n;
  Number d;
  Number above(const PointOf<Number>& u) const { return dot(n, u) - d; }
  LineOf operator-() const { return {{-n.x, -n.y}, -d}; }
};
using Line = LineOf<double>;

// Where Number is known from another argument, a polygon may be given, too.
template <class Number>
using Corners = Given<Vector<const PointOf<Number>>>;

template <class Number>
struct PolygonOf {
  std::vector<PointOf<Number>> corners;
  std::vector<PointOf<Number>> spare;  // for cuts, as much room as for corners

  void reserve(Index count) { corners.reserve(count), spare.reserve(count); }
  operator Vector<const PointOf<Number>>() const { return {corners.data(), static_cast<Index>(corners.size())}; }
  bool is_point() const { return corners.size() == 1; }
};
using Polygon = PolygonOf<double>;

// Returns corners (V, 2) that NumPy holds, as points.
static_assert(sizeof(Point) == 2 * sizeof(double));
inline Vector<const Point> points(Matrix<const double> corners) {
  return {reinterpret_cast<const Point*>(corners.data), corners.rows};
}

template <class Number>
struct Range {
  Number low, high;
};

// Returns the least and the greatest n u on a polygon.
template <class Number>
Range<Number> span(Corners<Number> corners, const PointOf<Number>& n) {
  Range<Number> range{INFINITY, -INFINITY};
  for (const PointOf<Number>& u : corners) {
    const Number value = dot(n, u);
    range = {min(range.low, value), max(range.high, value)};
  }
  return range;
}

// Keeps, of the corners with n u >= level, the two that are farthest apart.
template <class Number>
void keep_face(PolygonOf<Number>& polygon, const PointOf<Number>& n, const Number& level, double same) {
  Number first = INFINITY, last = -INFINITY;
  PointOf<Number> right{}, left{};
  for (const PointOf<Number>& u : polygon.corners) {
    if (!(dot(n, u) >= level)) continue;
    const Number along = n.x * u.y - n.y * u.x;
    if (along < first) first = along, right = u;
    if (along > last) last = along, left = u;
  }
  polygon.corners.assign(1, right);
  if (last - first > same) polygon.corners.push_back(left);
}

// Cuts a polygon to n u >= d; to its face of greatest n u where that is empty. `radius` is the
// largest norm of an input. A line of NaN cuts nothing.
template <class Number>
void cut(PolygonOf<Number>& polygon, const LineOf<Number>& line, double radius) {
  const double thin = tolerances::THIN * radius, same = tolerances::SAME_CORNER * radius;
  const auto [lowest, highest] = span(polygon, line.n);
  if (!(lowest < line.d)) return;
  if (highest <= line.d + thin)  // compared before d is subtracted, which may be huge
    return keep_face<Number>(polygon, line.n, highest - thin, same);
  std::vector<PointOf<Number>>& kept = polygon.spare;
  kept.clear();
  const auto near = [same](const PointOf<Number>& a, const PointOf<Number>& b) {
    return abs(a.x - b.x) <= same && abs(a.y - b.y) <= same;
  };
  const auto keep = [&](const PointOf<Number>& u) {
    if (kept.empty() || !near(kept.back(), u)) kept.push_back(u);
  };
  PointOf<Number> from = polygon.corners.back();
  Number before = line.above(from);
  for (const PointOf<Number>& u : polygon.corners) {
    const Number here = line.above(u);
    if ((here >= 0.0) != (before >= 0.0)) keep(between<Number>(from, u, before / (before - here)));
    if (here >= 0.0) keep(u);
    from = u, before = here;
  }
  while (kept.size() > 1 && near(kept.front(), kept.back())) kept.pop_back();
  polygon.corners.swap(kept);
}

// Cuts a polygon to n u = d, a value that it attains.
template <class Number>
void slice_at(PolygonOf<Number>& polygon, const LineOf<Number>& line, double radius) {
  cut(polygon, line, radius);
  cut(polygon, -line, radius);
}

// Returns whether a point is in a polygon of three corners or more, without any tolerance.
template <class Number>
bool contains(Corners<Number> corners, const PointOf<Number>& u) {
  PointOf<Number> from = corners[corners.size - 1];
  for (const PointOf<Number>& to : corners) {
    if ((to.x - from.x) * (u.y - from.y) < (to.y - from.y) * (u.x - from.x)) return false;
    from = to;
  }
  return true;
}

// |R u - z|^2 with R = [[r11, r12], [0, r22]].
template <class Number>
struct LeastSquaresOf {
  Number r11 = 0.0, r12 = 0.0, r22 = 0.0;
  PointOf<Number> z{0.0, 0.0};

  // w |u - centre|^2
  static LeastSquaresOf distance(double weight, const PointOf<Number>& centre) {
    const double root = sqrt(weight);
    return {root, 0.0, root, {root * centre.x, root * centre.y}};
  }
  // Adds (a u - t)^2 by two Givens rotations: no square is formed.
  void add(const Number& ax, Number ay, Number t) {
    if (ax != 0.0) {
      const Number length = hypot(r11, ax), c = r11 / length, s = ax / length;
      const Number above = r12, wanted = z.x;
      r11 = length;
      r12 = c * above + s * ay, ay = c * ay - s * above;
      z.x = c * wanted + s * t, t = c * t - s * wanted;
    }
    if (ay != 0.0) {
      const Number length = hypot(r22, ay), c = r22 / length, s = ay / length;
      r22 = length;
      z.y = c * z.y + s * t;
    }
  }
  PointOf<Number> image(const PointOf<Number>& d) const { return {r11 * d.x + r12 * d.y, r22 * d.y}; }
  PointOf<Number> residual(const PointOf<Number>& u) const {
    const PointOf<Number> v = image(u);
    return {v.x - z.x, v.y - z.y};
  }
};
using LeastSquares = LeastSquaresOf<double>;

// Returns the minimiser over a polygon of a problem of full rank with its centre at `centre`.
//
// The point is chosen by the signs of the gradient, not by comparing costs, whose differences drown
// in rounding where the weights are large.
template <class Number>
PointOf<Number> descend(Corners<Number> corners, const LeastSquaresOf<Number>& problem,
                        const Given<PointOf<Number>>& centre) {
  const Index count = corners.size;
  if (count == 1) return corners[0];
  if (count > 2 && contains<Number>(corners, centre)) return centre;
  const auto side = [&](Index i, Index j) {
    return PointOf<Number>{corners[j].x - corners[i].x, corners[j].y - corners[i].y};
  };
  Number least = INFINITY;
  PointOf<Number> best = corners[0];
  Number arriving = dot(problem.image(side(count - 1, 0)), problem.residual(corners[0]));
  for (Index i = 0; i < count; ++i) {
    const PointOf<Number> along = side(i, i + 1 < count ? i + 1 : 0), step = problem.image(along);
    PointOf<Number> u = corners[i], e = problem.residual(u);
    const Number leaving = dot(step, e);
    if (leaving >= 0.0 && arriving <= 0.0) return u;
    const Number t = -leaving / dot(step, step);
    arriving = leaving + step.x * step.x + step.y * step.y;
    if (0.0 < t && t < 1.0) {
      u = {u.x + t * along.x, u.y + t * along.y}, e = problem.residual(u);
      const PointOf<Number> gradient{problem.r11 * e.x, problem.r12 * e.x + problem.r22 * e.y};
      if (-along.y * gradient.x + along.x * gradient.y >= 0.0 || count == 2) return u;  // it points inwards
    }
    if (const Number cost = dot(e, e); cost < least) least = cost, best = u;
  }
  return best;
}

// Returns the point of a polygon that is nearest to u*.
template <class Number = double>
PointOf<Number> nearest(Corners<Number> corners, const PointOf<Number>& u_nominal) {
  return descend(corners, LeastSquaresOf<Number>::distance(1.0, u_nominal), u_nominal);
}

// Returns the point of a polygon that minimises |R u - z|^2; of several, the nearest to u*.
// `chord` is written to.
template <class Number>
PointOf<Number> minimise(const PolygonOf<Number>& polygon, const LeastSquaresOf<Number>& problem,
                         const Given<PointOf<Number>>& u_nominal, double radius, PolygonOf<Number>& chord) {
  const auto& [r11, r12, r22, z] = problem;
  const Number size = sqrt(r11 * r11 + r12 * r12 + r22 * r22);
  if (size <= tolerances::ZERO_GRADIENT) return nearest<Number>(polygon, u_nominal);
  if (abs(r11 * r22) > tolerances::RANK_ONE * size * size) {
    const Number y = z.y / r22;
    return descend(polygon, problem, {(z.x - r12 * y) / r11, y});
  }
  // R = sigma p n': n u is decided, and u* decides the rest
  const Number angle = 0.5 * atan2(2.0 * r11 * r12, r11 * r11 - r12 * r12 - r22 * r22);
  const PointOf<Number> n{cos(angle), sin(angle)}, p = problem.image(n);
  const auto [low, high] = span(polygon, n);
  const Number target = min(max(dot(p, z) / dot(p, p), low), high);
  chord.corners = polygon.corners;
  slice_at(chord, {n, target}, radius);
  return nearest<Number>(chord, u_nominal);
}

}  // namespace hcbf::polygon
