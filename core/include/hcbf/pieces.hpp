// Many convex polygons in one array of numbers, with buckets that find those near a point.
//
// Several such arrays follow one another in an *atlas*; `at` is where one of them begins. Buckets
// are squares in the frame of the map's grid, so that pieces along its axes are in few of them. A piece
// is in all buckets that its box meets, and is reported from the first of those that a search visits.
// Places in the array are numbers of it, exact as doubles up to 2⁵³.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <vector>

#include <hcbf/constants.hpp>
#include <hcbf/arrays.hpp>
#include <hcbf/shapes.hpp>
#include <hcbf/layout.hpp>

namespace hcbf::pieces {

// Where the head holds how many pieces there are, the buckets' side [m], columns and rows, the frame's
// origin and turn, and where the lists begin, counted from the head.
enum Head { COUNT, SIDE, COLUMNS, ROWS, X, Y, COS, SIN, STARTS, ITEMS, RINGS, BOXES, BLOCKS, HEAD_SIZE };

constexpr Index BOX = 8;              // numbers of a box: least and greatest u and v [m], and its buckets
constexpr double LEAST_SIDE = 0.5;    // of a bucket [m]
constexpr double MOST_BUCKETS = 4096;

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

struct Frame {
  double x, y, cos, sin;  // of its origin [m], and its turn
  Place of(double px, double py) const {
    const double dx = px - x, dy = py - y;
    return {cos * dx + sin * dy, cos * dy - sin * dx};
  }
};

inline Index whole(Vector<const double> atlas, Index i) { return static_cast<Index>(atlas[i]); }

inline Lists lists_of(Vector<const double> atlas, Index at) {
  return {at + whole(atlas, at + STARTS), at + whole(atlas, at + ITEMS), at + whole(atlas, at + BOXES),
          at + whole(atlas, at + BLOCKS)};
}

inline Place in_frame(Vector<const double> atlas, Index at, double x, double y) {
  return Frame{atlas[at + X], atlas[at + Y], atlas[at + COS], atlas[at + SIN]}.of(x, y);
}

// The bucket of a coordinate of the frame, the nearest for one beyond the last. NaN is in the first one:
// as an index it would point out of the atlas.
inline Index bucket_of(Vector<const double> atlas, Index at, double place, Index most) {
  const double sides = place / atlas[at + SIDE];
  return sides > 0.0 ? static_cast<Index>(std::min(sides, most - 1.0)) : 0;
}

// The signed distance from the piece with the block at `block` [m].
inline double height(Vector<const double> atlas, Index block, double x, double y) {
  return ConvexPolygon::jet(&atlas[block], x, y).h;
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
        const Index first_c = std::max(whole(atlas, box + 4), c0);
        const Index first_r = std::max(whole(atlas, box + 5), r0);
        if (first_c != c || first_r != r) continue;  // an earlier bucket has it
        if (box_distance(atlas, box, u, v) > reach) continue;
        const Index block = lists.blocks + layout::WIDTH * piece;
        if (height(atlas, block, x, y) <= reach) take(block);
      }
    }
}

// Writes the blocks of the pieces no farther than `reach` [m], and returns how many there are. Where
// there are more than `found` (k,) has room for, only their number is of use.
inline Index near(Vector<const double> atlas, Index at, double x, double y, double reach,
                  Vector<Index> found) {
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
  const Place place = in_frame(atlas, at, x, y);
  const double u = place.u, v = place.v;  // C++17 captures no structured binding
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
  const Index nearest_ring = whole(atlas, at + whole(atlas, at + RINGS) + r * columns + c);
  for (Index ring = nearest_ring; ring <= columns + rows; ++ring) {
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
  if (found.block < 0) return {constants::FARTHEST, 0.0, 0.0};
  const auto there = ConvexPolygon::jet(&atlas[found.block], x, y);
  return {std::min(found.distance, constants::FARTHEST), there.gx, there.gy};
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

// How many buckets away the nearest is that holds a piece, (rows, columns); diagonal steps count as one.
// Two sweeps are exact for that distance. `held`: (rows, columns) how many pieces each bucket holds.
inline void rings(Matrix<const Index> held, Matrix<double> out) {
  const Index rows = held.rows, columns = held.columns;
  for (Index i = 0; i < rows * columns; ++i) out.data[i] = held.data[i] > 0 ? 0.0 : double(rows + columns);
  const auto pull = [&](Index r, Index c, Index from_r, Index from_c) {
    if (from_r >= 0 && from_r < rows && from_c >= 0 && from_c < columns)
      out(r, c) = std::min(out(r, c), out(from_r, from_c) + 1.0);
  };
  for (Index r = 0; r < rows; ++r)
    for (Index c = 0; c < columns; ++c) {
      for (Index j = c - 1; j <= c + 1; ++j) pull(r, c, r - 1, j);
      pull(r, c, r, c - 1);
    }
  for (Index r = rows - 1; r >= 0; --r)
    for (Index c = columns - 1; c >= 0; --c) {
      for (Index j = c - 1; j <= c + 1; ++j) pull(r, c, r + 1, j);
      pull(r, c, r, c + 1);
    }
}

// Writes the boxes of polygons in the frame, and returns what is around the first `inner`, as a box.
inline std::array<double, 4> write_boxes(Matrix<const double> blocks, const Frame& frame, Index inner,
                                         Matrix<double> boxes) {
  std::array<double, 4> around{INFINITY, INFINITY, -INFINITY, -INFINITY};
  for (Index p = 0; p < blocks.rows; ++p) {
    double* box = boxes[p].data;
    box[0] = box[1] = INFINITY, box[2] = box[3] = -INFINITY;
    for (Index i = 0; i < whole(blocks[p], ConvexPolygon::COUNT); ++i) {
      const Index at = ConvexPolygon::FIRST + 2 * i;
      const auto [u, v] = frame.of(blocks(p, at), blocks(p, at + 1));
      box[0] = std::min(box[0], u), box[1] = std::min(box[1], v);
      box[2] = std::max(box[2], u), box[3] = std::max(box[3], v);
    }
    for (Index k = 0; k < 2 && p < inner; ++k) {
      around[k] = std::min(around[k], box[k]);
      around[2 + k] = std::max(around[2 + k], box[2 + k]);
    }
  }
  return inner > 0 ? around : std::array<double, 4>{0.0, 0.0, 0.0, 0.0};
}

// The array of polygons with the blocks (P, WIDTH), the first `inner` in buckets; what is beyond all
// buckets is in the nearest.
inline std::vector<double> packed(Matrix<const double> blocks, double x, double y, double yaw, Index inner) {
  const Index count = blocks.rows;
  const Frame frame{x, y, std::cos(yaw), std::sin(yaw)};
  std::vector<double> boxes(count * BOX);
  const auto [low_u, low_v, high_u, high_v] = write_boxes(blocks, frame, inner, {boxes.data(), count, BOX});
  const double wide = high_u - low_u, high = high_v - low_v;
  double side = std::max(LEAST_SIDE, std::sqrt(wide * high / MOST_BUCKETS));
  side = std::max({side, wide / MOST_BUCKETS, high / MOST_BUCKETS});
  const Index columns = static_cast<Index>(wide / side) + 1, rows = static_cast<Index>(high / side) + 1;
  const double low[2] = {low_u, low_v}, last[2] = {columns - 1.0, rows - 1.0};
  for (Index p = 0; p < count; ++p)
    for (Index k = 0; k < 4; ++k) {
      double* box = boxes.data() + BOX * p;
      box[4 + k] = std::trunc(std::min(std::max(0.0, (box[k] - low[k % 2]) / side), last[k % 2]));
      box[k] -= low[k % 2];  // the first bucket is the origin
    }
  const auto visit_buckets = [&](auto take) {
    for (Index p = 0; p < count; ++p) {
      const double* box = boxes.data() + BOX * p;
      for (Index r = Index(box[5]); r <= Index(box[7]); ++r)
        for (Index c = Index(box[4]); c <= Index(box[6]); ++c) take(r * columns + c, p);
    }
  };
  std::vector<Index> held(columns * rows), filled(columns * rows + 1);
  visit_buckets([&](Index bucket, Index) { ++held[bucket]; });
  for (Index i = 0; i < columns * rows; ++i) filled[i + 1] = filled[i] + held[i];
  const Index starts = HEAD_SIZE, items = starts + columns * rows + 1, rings_at = items + filled.back();
  const Index boxes_at = rings_at + columns * rows, blocks_at = boxes_at + count * BOX;
  std::vector<double> out(blocks_at + count * layout::WIDTH);
  const double origin_x = x + frame.cos * low_u - frame.sin * low_v;
  const double origin_y = y + frame.sin * low_u + frame.cos * low_v;
  const double head[HEAD_SIZE] = {double(count),    side,           double(columns), double(rows),
                                  origin_x,         origin_y,       frame.cos,       frame.sin,
                                  double(starts),   double(items),  double(rings_at), double(boxes_at),
                                  double(blocks_at)};
  std::copy_n(head, HEAD_SIZE, out.begin());
  std::copy(filled.begin(), filled.end(), out.begin() + starts);
  visit_buckets([&](Index bucket, Index piece) { out[items + filled[bucket]++] = double(piece); });
  rings({held.data(), rows, columns}, {out.data() + rings_at, rows, columns});
  std::copy(boxes.begin(), boxes.end(), out.begin() + boxes_at);
  std::copy_n(blocks.data, count * layout::WIDTH, out.begin() + blocks_at);
  return out;
}

}  // namespace hcbf::pieces
