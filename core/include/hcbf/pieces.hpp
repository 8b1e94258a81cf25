// Many convex polygons in one array of numbers, with buckets that find those near a point.
//
// Several such arrays stand behind one another in an *atlas*; `at` is where one of them begins. Buckets
// are squares in the frame of the map's grid, so that pieces along its axes are in few of them. A piece
// is in all buckets that its box meets, and is reported from the first of those that a search visits.
// Places in the array are numbers of it, exact as doubles up to 2⁵³.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

#include <hcbf/arrays.hpp>
#include <hcbf/convex_polygon.hpp>
#include <hcbf/layout.hpp>

namespace hcbf::pieces {

// Where the head holds how many pieces there are, the buckets' side [m], columns and rows, the frame's
// origin and turn, and where the lists begin, counted from the head.
enum Head { COUNT, SIDE, COLUMNS, ROWS, X, Y, COS, SIN, STARTS, ITEMS, RINGS, BOXES, BLOCKS, HEAD_SIZE };

constexpr Index BOX = 8;              // numbers of a box: least and greatest u and v [m], and its buckets
constexpr double LEAST_SIDE = 0.5;    // of a bucket [m]
constexpr double MOST_BUCKETS = 4096;
constexpr double FARTHEST = 1e4;      // where there is no piece [m]

struct Nearest {
  double distance;  // signed [m]; infinite where there is no piece
  Index block;      // where its block begins in the atlas; −1 where there is none
};

struct Place {
  double u, v;  // in the frame of the buckets [m]
};

// Where the lists begin in the atlas: of each bucket's entries among the items, the numbers of pieces
// bucket after bucket, their boxes and their blocks.
struct Lists {
  Index starts, items, boxes, blocks;
};

inline Index whole(Vector<const double> atlas, Index i) { return static_cast<Index>(atlas[i]); }

inline Lists lists_of(Vector<const double> atlas, Index at) {
  return {at + whole(atlas, at + STARTS), at + whole(atlas, at + ITEMS), at + whole(atlas, at + BOXES),
          at + whole(atlas, at + BLOCKS)};
}

inline Place in_frame(Vector<const double> atlas, Index at, double x, double y) {
  const double dx = x - atlas[at + X], dy = y - atlas[at + Y];
  const double cos = atlas[at + COS], sin = atlas[at + SIN];
  return {cos * dx + sin * dy, cos * dy - sin * dx};
}

// The bucket of a coordinate of the frame, the nearest for one beyond the last. What is no number is in
// the first one: as an index it would lead out of the atlas.
inline Index bucket_of(Vector<const double> atlas, Index at, double place, Index most) {
  const double sides = place / atlas[at + SIDE];
  return sides > 0.0 ? static_cast<Index>(std::min(sides, most - 1.0)) : 0;
}

// The signed distance from the piece with the block at `block` [m].
inline double height(Vector<const double> atlas, Index block, double x, double y) {
  return convex_polygon::jet(&atlas[block], x, y).h;
}

// The distance of a point of the frame from a piece's box [m].
inline double box_distance(Vector<const double> atlas, Index box, double u, double v) {
  const double du = std::max({atlas[box] - u, u - atlas[box + 2], 0.0});
  const double dv = std::max({atlas[box + 1] - v, v - atlas[box + 3], 0.0});
  return std::sqrt(du * du + dv * dv);
}

// Hands the block of each piece no farther than `reach` [m] to `take`.
template <class Take>
void visit_near(Vector<const double> atlas, Index at, double x, double y, double reach, Take take) {
  const Index columns = whole(atlas, at + COLUMNS), rows = whole(atlas, at + ROWS);
  const auto [u, v] = in_frame(atlas, at, x, y);
  const Index c0 = bucket_of(atlas, at, u - reach, columns), c1 = bucket_of(atlas, at, u + reach, columns);
  const Index r0 = bucket_of(atlas, at, v - reach, rows), r1 = bucket_of(atlas, at, v + reach, rows);
  const Lists lists = lists_of(atlas, at);
  for (Index r = r0; r <= r1; ++r)
    for (Index c = c0; c <= c1; ++c) {
      const Index bucket = lists.starts + r * columns + c;
      const Index end = lists.items + whole(atlas, bucket + 1);
      for (Index i = lists.items + whole(atlas, bucket); i < end; ++i) {
        const Index piece = whole(atlas, i), box = lists.boxes + BOX * piece;
        const bool first = std::max(whole(atlas, box + 4), c0) == c && std::max(whole(atlas, box + 5), r0) == r;
        if (!first || box_distance(atlas, box, u, v) > reach) continue;  // an earlier bucket has it
        const Index block = lists.blocks + layout::WIDTH * piece;
        if (height(atlas, block, x, y) <= reach) take(block);
      }
    }
}

// Writes the blocks of the pieces no farther than `reach` [m], and returns how many there are. Where
// there are more than `found` (k,) has room for, only their number is of use.
inline Index near(Vector<const double> atlas, Index at, double x, double y, double reach, Vector<Index> found) {
  Index total = 0;
  visit_near(atlas, at, x, y, reach, [&](Index block) {
    if (total < found.size) found[total] = block;
    ++total;
  });
  return total;
}

// The piece with the least signed distance from a point.
//
// Buckets are searched in rings. A piece that no ring up to the k-th holds is no nearer than k sides and
// the distance from the point to the edge of its own bucket. For a point beyond all buckets that holds of
// the nearest point of them, and no piece is nearer to the one than to the other.
inline Nearest nearest(Vector<const double> atlas, Index at, double x, double y) {
  Nearest best{INFINITY, -1};
  if (atlas[at + COUNT] == 0.0) return best;
  const Index columns = whole(atlas, at + COLUMNS), rows = whole(atlas, at + ROWS);
  const double side = atlas[at + SIDE];
  const auto [u, v] = in_frame(atlas, at, x, y);
  const Index c = bucket_of(atlas, at, u, columns), r = bucket_of(atlas, at, v, rows);
  const Lists lists = lists_of(atlas, at);
  const double inside_u = std::min(std::max(u - c * side, 0.0), side);
  const double inside_v = std::min(std::max(v - r * side, 0.0), side);
  const double edge = std::min({inside_u, side - inside_u, inside_v, side - inside_v});
  const auto look_into = [&](Index bucket) {
    const Index end = lists.items + whole(atlas, bucket + 1);
    for (Index k = lists.items + whole(atlas, bucket); k < end; ++k) {
      const Index piece = whole(atlas, k);
      if (box_distance(atlas, lists.boxes + BOX * piece, u, v) > std::max(best.distance, 0.0)) continue;
      const Index block = lists.blocks + layout::WIDTH * piece;
      const double distance = height(atlas, block, x, y);
      if (distance < best.distance) best = {distance, block};
    }
  };
  for (Index ring = whole(atlas, at + whole(atlas, at + RINGS) + r * columns + c); ring <= columns + rows; ++ring) {
    const Index last = std::min(r + ring, rows - 1);
    for (Index i = std::max<Index>(r - ring, 0); i <= last; ++i) {
      const bool full = std::abs(i - r) == ring || ring == 0;  // else its two ends
      for (Index j = c - ring; j <= c + ring; j += full ? 1 : 2 * ring)
        if (0 <= j && j < columns) look_into(lists.starts + i * columns + j);
    }
    if (best.distance <= ring * side + edge) break;
  }
  return best;
}

struct Slope {
  double h, gx, gy;  // signed distance [m] and its gradient, 0 without a piece
};

// The signed distance from the nearest piece.
inline Slope jet(Vector<const double> atlas, Index at, double x, double y) {
  const Nearest found = nearest(atlas, at, x, y);
  if (found.block < 0) return {FARTHEST, 0.0, 0.0};
  const auto there = convex_polygon::jet(&atlas[found.block], x, y);
  return {std::min(found.distance, FARTHEST), there.gx, there.gy};
}

// Writes the signed distances (N,) of points (N, 2) from the nearest piece [m].
inline void distances(Vector<const double> atlas, Index at, Matrix<const double> points, Vector<double> out) {
  for (Index i = 0; i < points.rows; ++i) out[i] = nearest(atlas, at, points(i, 0), points(i, 1)).distance;
}

// Writes the signed distances (k,) of points, the first columns of `path` (k, …), from pieces. The
// points are close to one another: what is near the first is looked up once.
inline void along(Vector<const double> atlas, Index at, Matrix<const double> path, Vector<double> distance) {
  const double x = path(0, 0), y = path(0, 1);
  const Nearest first = nearest(atlas, at, x, y);
  std::fill_n(distance.data, distance.size, first.block < 0 ? first.distance : INFINITY);
  distance[0] = first.distance;
  if (first.block < 0) return;
  double far = 0.0;
  for (Index s = 1; s < path.rows; ++s) far = std::max(far, std::hypot(path(s, 0) - x, path(s, 1) - y));
  visit_near(atlas, at, x, y, std::max(first.distance, 0.0) + 2.0 * far, [&](Index block) {
    for (Index s = 1; s < path.rows; ++s)
      distance[s] = std::min(distance[s], height(atlas, block, path(s, 0), path(s, 1)));
  });
}

}  // namespace hcbf::pieces
