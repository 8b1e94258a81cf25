// Cells covered by few convex pieces: greedy rectangles, merged where their hull stays near them.
//
// A piece is the convex hull of some rectangles of cells. It has at most eight corners, all on the grid's
// crossings, and holds no point that is more than one cell from an occupied square: it meets no cell but
// occupied ones and those that share an edge with one. So a cell that is covered is never lost, and a gap
// narrows by at most one cell from each side.
//
// A merge is looked at row by row. All merges together may look at no more than `WORK` rows for each cell,
// so that the cost grows with the cells and with nothing else. Rooms need a few rows for each cell. Where a
// raster needs more, what is left stays in more pieces, which cover the same cells.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include <hcbf/arrays.hpp>

namespace hcbf::cover {

using Number = std::int32_t;  // of a rectangle or a piece

constexpr Index WORK = 100, LEAST_WORK = 1'000'000;  // rows that merges may look at: a cell, and in all
constexpr Index MOST_CORNERS = 8;                    // of a piece, as many as a polygon's block holds
constexpr double GROWTH = 1e-6;  // by how much pieces reach beyond their cells [cell]: more than any rounding

struct Window {
  Index r0, c0, r1, c1;  // first row and column, row and column after the last
  Index rows() const { return r1 - r0; }
  Index columns() const { return c1 - c0; }
};

struct Crossing {
  Index x, y;  // column and row
  bool operator==(const Crossing& other) const { return x == other.x && y == other.y; }
};

// Corners of one piece, counter-clockwise; the rest is 0.
using Corners = std::array<Crossing, MOST_CORNERS>;

struct Pieces {
  std::vector<Corners> corners;
  std::vector<Index> count;
};

struct Box {
  Index r0, c0, r1, c1;  // as of a window
  std::array<Crossing, 4> corners() const { return {{{c0, r0}, {c1, r0}, {c1, r1}, {c0, r1}}}; }
};

// Returns rectangles of the true cells of a window that no piece owns, and notes who owns them.
//
// The wider or the higher of two rectangles is taken at each cell that nothing owns: as far right as there
// are cells and then up, or as far up and then right. first: number of the first rectangle.
inline std::vector<Box> rectangles(Matrix<const bool> cells, const Window& window, Matrix<Number> owner,
                                   Index first) {
  const Index height = window.rows(), width = window.columns();
  const auto [r0, c0, r1, c1] = window;
  std::vector<Number> rights((height + 1) * (width + 1)), ups((height + 1) * (width + 1));
  const Matrix<Number> right{rights.data(), height + 1, width + 1};  // cells in a row from here on
  const Matrix<Number> up{ups.data(), height + 1, width + 1};
  for (Index r = height - 1; r >= 0; --r)
    for (Index c = width - 1; c >= 0; --c)
      if (cells(r0 + r, c0 + c)) right(r, c) = right(r, c + 1) + 1, up(r, c) = up(r + 1, c) + 1;
  std::vector<Box> boxes;
  for (Index r = 0; r < height; ++r)
    for (Index c = 0; c < width; ++c) {
      if (right(r, c) == 0 || owner(r0 + r, c0 + c) >= 0) continue;
      Index wide = right(r, c), high = 1;
      while (right(r + high, c) >= wide) ++high;
      Index tall = up(r, c), broad = 1;
      while (up(r, c + broad) >= tall) ++broad;
      if (tall * broad > wide * high) wide = broad, high = tall;
      const Box box{r0 + r, c0 + c, r0 + r + high, c0 + c + wide};
      for (Index i = box.r0; i < box.r1; ++i)
        for (Index j = box.c0; j < box.c1; ++j)
          if (owner(i, j) < 0) owner(i, j) = static_cast<Number>(first + boxes.size());
      boxes.push_back(box);
    }
  return boxes;
}

// Cells of a window that share no edge with a true one, and are none: how many are left of a place in its
// row.
class Strangers {
 public:
  Strangers(Matrix<const bool> cells, const Window& window) : window_(window) {
    const auto [r0, c0, r1, c1] = window;
    counted_.resize(window.rows() * (window.columns() + 1));
    Number* here = counted_.data();
    for (Index r = r0; r < r1; ++r, ++here)
      for (Index c = c0; c < c1; ++c, ++here) {
        const bool beside = (c > 0 && cells(r, c - 1)) || (c + 1 < cells.columns && cells(r, c + 1));
        const bool above = (r > 0 && cells(r - 1, c)) || (r + 1 < cells.rows && cells(r + 1, c));
        const bool near = cells(r, c) || beside || above;
        here[1] = here[0] + !near;
      }
  }

  const Window& window() const { return window_; }
  Index size() const { return static_cast<Index>(counted_.size()); }
  // Whether there is one among the columns of a row.
  bool between(Index row, Index first, Index last) const {
    const Index begin = (row - window_.r0) * (window_.columns() + 1) - window_.c0;
    return counted_[begin + last] != counted_[begin + first];
  }

 private:
  Window window_;
  std::vector<Number> counted_;
};

// Returns twice the area of the triangle a, b, p, positive where it turns left.
inline Index turn(Crossing a, Crossing b, Crossing p) {
  return (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x);
}

using Points = std::array<Crossing, MOST_CORNERS + 4>;
using Hull = std::array<Crossing, 2 * (MOST_CORNERS + 4)>;

// Writes the convex hull of n points, strictly convex, counter-clockwise; returns its size. Sorts the points.
//
// Source: A. M. Andrew's monotone chain, in integers.
inline Index hull_of(Points& points, Index n, Hull& out) {
  std::sort(points.begin(), points.begin() + n,
            [](Crossing a, Crossing b) { return a.x < b.x || (a.x == b.x && a.y < b.y); });
  Index size = 0;
  for (const bool back : {false, true}) {
    const Index floor = back ? size : size + 1;
    for (Index step = 0; step < n; ++step) {
      const Crossing p = points[back ? n - 1 - step : step];
      while (size > floor && turn(out[size - 2], out[size - 1], p) <= 0) --size;
      if (back && step == 0) continue;  // it is the last one already
      out[size++] = p;
    }
  }
  return size - 1;
}

// Rounded down, as in Python.
struct Division {
  Index quotient, remainder;
};
inline Division floor_division(Index a, Index b) {  // b > 0
  const Index q = a / b, r = a % b;
  return r < 0 ? Division{q - 1, r + b} : Division{q, r};
}

// Returns whether a hull of k corners meets the inside of a stranger, row by row.
//
// Corners are on crossings, so that a row's outermost points are those on its lower or upper line. Edges
// that rise bound rows on the right, those that fall on the left. extents: (h, 2) room for the first and the
// last column of each row of the window.
inline bool meets(const Hull& hull, Index k, const Strangers& strangers,
                  std::vector<std::array<Index, 2>>& extents) {
  const Index r0 = strangers.window().r0;
  Index low = hull[0].y, high = hull[0].y;
  for (Index i = 0; i < k; ++i) {
    Crossing from = hull[i > 0 ? i - 1 : k - 1], to = hull[i];
    low = std::min(low, to.y), high = std::max(high, to.y);
    if (from.y == to.y) continue;
    const bool rises = from.y < to.y;
    if (!rises) std::swap(from, to);
    const Index sign = rises ? -1 : 1;  // rounded down on the left, up on the right
    const Index rise = to.y - from.y;
    const auto [steps, more] = floor_division(sign * (to.x - from.x), rise);
    Index at = sign * from.x, over = 0;
    for (Index row = from.y - r0; row < to.y - r0; ++row) {
      const Index here = at;
      at += steps, over += more;
      if (over >= rise) ++at, over -= rise;
      extents[row][rises] = sign * std::min(here, at);
    }
  }
  for (Index row = low; row < high; ++row)
    if (strangers.between(row, extents[row - r0][0], extents[row - r0][1])) return true;
  return false;
}

// Merges touching boxes for as long as their hull meets no stranger; writes which piece each went to.
inline Pieces merge(const std::vector<Box>& boxes, const Strangers& strangers, Matrix<const Number> owner,
                    Index first, std::vector<Number>& piece_of) {
  const Index total = static_cast<Index>(boxes.size());
  Index left = std::max(LEAST_WORK, WORK * strangers.size());
  std::vector<std::array<Index, 2>> extents(strangers.window().rows());
  std::vector<Number> tried(total, -1);
  std::vector<Index> waiting;
  Pieces pieces;
  Points points;
  Hull hull;
  for (Index seed = 0; seed < total; ++seed) {
    if (piece_of[seed] >= 0) continue;
    const Number piece = static_cast<Number>(pieces.count.size());
    Corners corners{};
    Index n = 4;
    std::copy_n(boxes[seed].corners().begin(), n, corners.begin());
    piece_of[seed] = piece;
    waiting.assign(1, seed);
    for (std::size_t begin = 0; begin < waiting.size(); ++begin) {
      const auto [a, b, c, d] = boxes[waiting[begin]];
      for (Index r = std::max<Index>(a - 1, 0); r < std::min(c + 1, owner.rows); ++r) {
        const bool on_side = a <= r && r < c;
        for (Index j = std::max<Index>(b - 1, 0), next; j < std::min(d + 1, owner.columns); j = next) {
          const Index other = owner(r, j) - first;
          next = on_side && b <= j && j < d ? d : j + 1;
          if (other < 0 || piece_of[other] >= 0 || tried[other] == piece) continue;
          tried[other] = piece;
          std::copy_n(corners.begin(), n, points.begin());
          std::copy_n(boxes[other].corners().begin(), 4, points.begin() + n);
          const Index size = hull_of(points, n + 4, hull);
          if (size > MOST_CORNERS) continue;
          if (size != n || !std::equal(hull.begin(), hull.begin() + size, corners.begin())) {
            const auto [low, high] = std::minmax_element(
                hull.begin(), hull.begin() + size, [](Crossing p, Crossing q) { return p.y < q.y; });
            left -= high->y - low->y;
            if (left < 0 || meets(hull, size, strangers, extents)) continue;
            corners = {};
            std::copy_n(hull.begin(), size, corners.begin());
            n = size;
          }
          piece_of[other] = piece;
          waiting.push_back(other);
        }
      }
    }
    pieces.corners.push_back(corners);
    pieces.count.push_back(n);
  }
  return pieces;
}

// Covers the true cells of a window that no piece owns, and notes who owns them.
//
// owner: (rows, columns) -1 where nothing owns a cell, written to; first: number of the first new piece.
inline Pieces cover(Matrix<const bool> cells, const Window& window, Matrix<Number> owner, Index first) {
  const auto [r0, c0, r1, c1] = window;
  for (Index r = r0; r < r1; ++r)
    for (Index c = c0; c < c1; ++c)
      if (!cells(r, c)) owner(r, c) = -1;
  const auto boxes = rectangles(cells, window, owner, first);
  std::vector<Number> piece_of(boxes.size(), -1);
  Pieces pieces = merge(boxes, {cells, window}, owner, first, piece_of);
  for (Index r = r0; r < r1; ++r)
    for (Index c = c0; c < c1; ++c)
      if (owner(r, c) >= first) owner(r, c) = static_cast<Number>(first + piece_of[owner(r, c) - first]);
  return pieces;
}

// Moves each corner (P, 8, 2) of pieces with so many (P,) outwards by `GROWTH` in column and row.
//
// The four outermost edges of a piece follow the grid, so that each corner is the outermost one in one
// quadrant, and the grown piece is the piece plus a square.
inline void grow(Cube<double> corners, Vector<const Index> count) {
  const auto sign = [](double x) { return static_cast<double>((x > 0.0) - (x < 0.0)); };
  for (Index p = 0; p < count.size; ++p) {
    const Index n = count[p];
    double piece[MOST_CORNERS][2];
    for (Index i = 0; i < n; ++i) piece[i][0] = corners(p, i, 0), piece[i][1] = corners(p, i, 1);
    for (Index i = 0; i < n; ++i) {
      const double *before = piece[i > 0 ? i - 1 : n - 1], *here = piece[i], *after = piece[(i + 1) % n];
      const double in_x = here[0] - before[0], in_y = here[1] - before[1];
      const double out_x = after[0] - here[0], out_y = after[1] - here[1];
      const double a = std::hypot(in_x, in_y), b = std::hypot(out_x, out_y);
      corners(p, i, 0) += GROWTH * sign(in_y / a + out_y / b);
      corners(p, i, 1) -= GROWTH * sign(in_x / a + out_x / b);
    }
  }
}

}  // namespace hcbf::cover
