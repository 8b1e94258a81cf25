// Where the cells of a field lie, and the path that a field leads along.
//
// A field is stored flat, row by row, and its geometry states where: the grid may be turned.
#pragma once
#include <algorithm>
#include <cmath>
#include <vector>

#include <hcbf/arrays.hpp>
#include <hcbf/march.hpp>

namespace hcbf::field {

// The numbers (7,) of a grid.
struct Geometry {
  double x, y;      // of the first cell's centre [m]
  double side;      // of a cell [m]
  double ny, nx;    // rows and columns
  double cos, sin;  // of the angle by which the grid is turned

  Index rows() const { return static_cast<Index>(ny); }
  Index columns() const { return static_cast<Index>(nx); }
};

struct Point {
  double x, y;  // [m]
};

// A place in cells, whole numbers at their centres.
struct Place {
  double row, column;
};

struct Cell {
  Index j, i;
};

// The (ny, nx) view of one scene's flat values.
template <class T>
Matrix<T> grid(Vector<T> values, const Geometry& geometry) {
  return {values.data, geometry.rows(), geometry.columns()};
}

inline Place to_cells(double x, double y, const Geometry& g) {
  const double away_x = x - g.x, away_y = y - g.y;
  return {(g.cos * away_y - g.sin * away_x) / g.side, (g.cos * away_x + g.sin * away_y) / g.side};
}

inline Point to_world(double row, double column, const Geometry& g) {
  const double along = column * g.side, up = row * g.side;
  return {g.x + g.cos * along - g.sin * up, g.y + g.sin * along + g.cos * up};
}

// The cell nearest a point.
inline Cell cell_of(double x, double y, const Geometry& g) {
  const Place at = to_cells(x, y, g);
  const double j = std::min(std::max(at.row, 0.0), g.ny - 1.0);
  const double i = std::min(std::max(at.column, 0.0), g.nx - 1.0);
  return {static_cast<Index>(std::nearbyint(j)), static_cast<Index>(std::nearbyint(i))};
}

// Writes the field of a painted ground, and through which rank the goal (2,) is reached, see `march`.
//
// cost, rank: (ny + 2, nx + 2) of the ground, with its border; opened: as `ground::paint_barriers` takes
// it; field, through: (capacity,), of which the first ny nx entries are written.
inline void solve(Matrix<const float> cost, Matrix<const march::Rank> rank, const Geometry& geometry,
                  const double* goal, Index opened, Vector<float> field, Vector<march::Rank> through) {
  const Index nx = cost.columns, size = cost.rows * nx;
  std::vector<float> arrival(size);
  std::vector<march::Rank> ranks(size);
  const Cell at = cell_of(goal[0], goal[1], geometry);
  march::march({{cost.data, size}, {rank.data, size}, nx, {arrival.data(), size}, {ranks.data(), size}},
               geometry.side, opened, (at.j + 1) * nx + at.i + 1);
  for (Index j = 0; j < cost.rows - 2; ++j) {
    const Index here = j * (nx - 2), there = (j + 1) * nx + 1;
    std::copy_n(arrival.data() + there, nx - 2, field.data + here);
    std::copy_n(ranks.data() + there, nx - 2, through.data + here);
  }
}

struct Crossing {
  Index rank;  // 0 where the path enters no closed region
  Cell cell;
};

// Returns the first closed region that the path from a cell enters, and where.
//
// What the path begins in counts only where it leads on into a higher rank; rank 0 is no region.
// rank: (ny + 2, nx + 2) of the ground; view: (ny, nx) T; opened: ranks from it on may be crossed, 0 for
// none.
inline Crossing crossing(Matrix<const march::Rank> rank, Matrix<const float> view, Cell at, Index opened) {
  constexpr Index sides[4][2] = {{0, 1}, {0, -1}, {1, 0}, {-1, 0}};
  Index within = rank(at.j + 1, at.i + 1);
  while (view(at.j, at.i) > 0.0f) {
    Cell low = at;
    for (const auto& [dj, di] : sides) {
      const Index y = at.j + dj, x = at.i + di;
      const bool inside = 0 <= y && y < view.rows && 0 <= x && x < view.columns;
      if (inside && view(y, x) < view(low.j, low.i)) low = {y, x};
    }
    if (low.j == at.j && low.i == at.i) return {1, at};
    at = low;
    const Index here = rank(at.j + 1, at.i + 1);
    if (!march::is_open(here, opened) && !(0 < within && within <= here)) return {here, at};
    within = within == 0 || here == 0 ? 0 : here;
  }
  return {0, at};
}

struct Slope {
  double value, by_row, by_column;
};

// T and its slope at a place, bilinear between the cells' centres.
inline Slope interpolate(Matrix<const float> view, Place at) {
  // NaN is 0, so that no index is out of range
  const double row = std::min(std::max(0.0, at.row), view.rows - 1.000001);
  const double column = std::min(std::max(0.0, at.column), view.columns - 1.000001);
  const Index j = static_cast<Index>(row), i = static_cast<Index>(column);
  const double q = row - j, p = column - i;
  const float t00 = view(j, i), t01 = view(j, i + 1), t10 = view(j + 1, i), t11 = view(j + 1, i + 1);
  const double by_row = (1.0 - p) * (t10 - t00) + p * (t11 - t01);
  const double by_column = (1.0 - q) * (t01 - t00) + q * (t11 - t10);
  const double lower = (1.0 - p) * t00 + p * t01, upper = (1.0 - p) * t10 + p * t11;
  return {(1.0 - q) * lower + q * upper, by_row, by_column};
}

// The lowest cell around the one nearest a place.
inline Place lowest_neighbour(Matrix<const float> view, Place at) {
  const Index j = static_cast<Index>(std::nearbyint(std::min(std::max(0.0, at.row), view.rows - 1.0)));
  const Index i = static_cast<Index>(std::nearbyint(std::min(std::max(0.0, at.column), view.columns - 1.0)));
  Cell low{j, i};
  for (Index y = std::max<Index>(j - 1, 0); y < std::min(j + 2, view.rows); ++y)
    for (Index x = std::max<Index>(i - 1, 0); x < std::min(i + 2, view.columns); ++x)
      if (view(y, x) < view(low.j, low.i)) low = {y, x};
  return {static_cast<double>(low.j), static_cast<double>(low.i)};
}

// Returns the point that is `length` further down the field, or the goal (2,) if that is nearer.
//
// Steps are one cell long and follow the gradient; one that would climb, in a valley narrower than two
// cells, goes to the lowest cell around instead. So T decreases at every step.
inline Point descent(Matrix<const float> view, const Geometry& geometry, const double* goal, double x,
                     double y, double length) {
  Place at = to_cells(x, y, geometry);
  const Place end = to_cells(goal[0], goal[1], geometry);
  Slope here = interpolate(view, at);
  for (Index steps = static_cast<Index>(std::ceil(length / geometry.side)); steps > 0; --steps) {
    const double up = end.row - at.row, along = end.column - at.column;
    if (up * up + along * along <= 2.25) return {goal[0], goal[1]};
    const double steep =
        std::max(std::sqrt(here.by_row * here.by_row + here.by_column * here.by_column), 1e-9);
    Place next{at.row - here.by_row / steep, at.column - here.by_column / steep};
    Slope there = interpolate(view, next);
    if (there.value >= here.value) {
      next = lowest_neighbour(view, at);
      there = interpolate(view, next);
    }
    at = next, here = there;
  }
  return to_world(at.row, at.column, geometry);
}

}  // namespace hcbf::field
