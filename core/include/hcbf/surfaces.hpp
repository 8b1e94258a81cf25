// Straight surfaces through the points that a turning beam has met, without cells.
//
// Neighbours in the list are neighbours in sight. Two of them see one surface where they are close, or where
// the beam meets the line between them at no flat angle: then all that is between them counts as occupied,
// also where beams between them saw nothing. A chain of such points is cut into straight pieces until each
// point is within a tolerance of the line that fits its piece best.
//
// Sources: the limit of the angle is the breakpoint detector of G. A. Borges and M.-J. Aldon, "Line
// extraction in 2D range images for mobile robotics", 2004; the cuts are those of D. H. Douglas and T. K.
// Peucker, 1973, with lines of total least squares in the place of chords.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <hcbf/arrays.hpp>

namespace hcbf::surfaces {

// 10 degrees: of the sine of the angle between a beam and a surface that it may have met.
constexpr double FLATTEST = 0.17364817766693033;
// 10 degrees: of the angle between two beams that may see one surface; at 1.5 m they are 26 cm apart.
constexpr double WIDEST = 0.17453292519943295;
constexpr double CLOSE = 0.05;     // points no farther apart belong together, as no robot passes [m]
constexpr double EDGE = 1e-3;      // by how much pieces reach beyond their outermost points [m]
constexpr double ROUNDING = 1e-6;  // by how much they reach towards the sensor: more than any rounding [m]

struct Point {
  double x, y;  // [m]
};
using Piece = std::array<Point, 4>;  // a rectangle, counter-clockwise

// Returns (k,) whether a point and the next one, after the last the first, see one surface.
inline std::vector<char> joined(Vector<const Point> points, double tolerance) {
  std::vector<char> found(points.size);
  for (Index i = 0; i < points.size; ++i) {
    const Point p = points[i], q = points[(i + 1) % points.size];
    const double apart = std::hypot(q.x - p.x, q.y - p.y);
    const double cross = std::abs(p.x * q.y - p.y * q.x);
    const double turn = std::atan2(cross, p.x * q.x + p.y * q.y);
    const double farther = std::max(std::hypot(p.x, p.y), std::hypot(q.x, q.y));
    const bool steep = cross >= FLATTEST * apart * farther;
    found[i] = apart <= CLOSE + 2.0 * tolerance || (turn <= WIDEST && steep);
  }
  return found;
}

struct Line {
  Point mean, along;  // a point of it and its direction
};

// Returns the line that fits points i to j best; where they are one point, it is across the beam.
inline Line line(Vector<const Point> chain, Index i, Index j) {
  Point mean{0.0, 0.0};
  const double count = static_cast<double>(j - i + 1);
  for (Index n = i; n <= j; ++n) mean.x += chain[n].x / count, mean.y += chain[n].y / count;
  double xx = 0.0, xy = 0.0, yy = 0.0;
  for (Index n = i; n <= j; ++n) {
    const double x = chain[n].x - mean.x, y = chain[n].y - mean.y;
    xx += x * x, xy += x * y, yy += y * y;
  }
  const double across = std::atan2(mean.x, -mean.y);
  const double angle = xx + yy > 0.0 ? 0.5 * std::atan2(2.0 * xy, xx - yy) : across;
  return {mean, {std::cos(angle), std::sin(angle)}};
}

// Returns which point between i and j is farthest from their chord, or from both as one.
inline Index farthest(Vector<const Point> chain, Index i, Index j) {
  const Point a = chain[i];
  const double ex = chain[j].x - a.x, ey = chain[j].y - a.y;
  double best = -1.0;
  Index at = i + 1;
  for (Index n = i + 1; n < j; ++n) {
    const double x = chain[n].x - a.x, y = chain[n].y - a.y;
    const double off = ex != 0.0 || ey != 0.0 ? std::abs(ex * y - ey * x) : std::hypot(x, y);
    if (off > best) best = off, at = n;
  }
  return at;
}

// Adds the pieces of a chain.
inline void cut(Vector<const Point> chain, double tolerance, double depth, std::vector<Piece>& out) {
  constexpr double INF = std::numeric_limits<double>::infinity();
  std::vector<std::pair<Index, Index>> waiting{{0, chain.size - 1}};
  while (!waiting.empty()) {
    const auto [i, j] = waiting.back();
    waiting.pop_back();
    auto [mean, along] = line(chain, i, j);
    double off = 0.0, low = INF, high = -INF;
    for (Index n = i; n <= j; ++n) {
      const double x = chain[n].x - mean.x, y = chain[n].y - mean.y;
      off = std::max(off, std::abs(along.x * y - along.y * x));
      const double at = along.x * x + along.y * y;
      low = std::min(low, at), high = std::max(high, at);
    }
    if (off > tolerance && j > i + 1) {
      const Index n = farthest(chain, i, j);
      waiting.push_back({i, n});
      waiting.push_back({n, j});
      continue;
    }
    if (along.x * mean.y - along.y * mean.x < 0.0) {  // the left of the line is to be farther away
      along = {-along.x, -along.y};
      std::swap(low, high);
      low = -low, high = -high;
    }
    const double near_x = mean.x + ROUNDING * along.y, near_y = mean.y - ROUNDING * along.x;
    const Point a{near_x + (low - EDGE) * along.x, near_y + (low - EDGE) * along.y};
    const Point b{near_x + (high + EDGE) * along.x, near_y + (high + EDGE) * along.y};
    out.push_back({a, b, Point{b.x - depth * along.y, b.y + depth * along.x},
                   Point{a.x - depth * along.y, a.y + depth * along.x}});
  }
}

// Returns rectangles along the surfaces that points show.
//
// points: in the sensor's axes, in the order in which a beam turns; tolerance: how far from a piece its
// points may be [m]; depth: how far pieces reach away from the sensor, where nothing was seen [m].
inline std::vector<Piece> pieces(Vector<const Point> points, double tolerance, double depth) {
  std::vector<Piece> out;
  const Index k = points.size;
  const auto together = joined(points, tolerance);
  Index start = 0;  // behind the first gap
  for (Index i = 0; i < k; ++i)
    if (!together[i]) {
      start = (i + 1) % k;
      break;
    }
  std::vector<Point> chain;
  for (Index last = 0; last < k; ++last) {
    const Index at = (start + last) % k;
    chain.push_back(points[at]);
    if (together[at] && last < k - 1) continue;
    if (together[at] && k > 2) chain.push_back(points[(at + 1) % k]);  // all of it is one ring
    cut({chain.data(), static_cast<Index>(chain.size())}, tolerance, depth, out);
    chain.clear();
  }
  return out;
}

}  // namespace hcbf::surfaces
