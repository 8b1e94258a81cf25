// The ground of a field: cells of a grid, the cost of each, and the highest rank that it is in.
//
// A metre costs 1 in the open, a little more close to an edge, so that the path leaves some distance where
// there is room, and far more in a region, so that it leads out by a short path. A cell of a map is in a
// region where its centre is nearer to the occupied squares than the clearance: the body's radius and what
// the edges reserve.
#pragma once
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <hcbf/arrays.hpp>
#include <hcbf/field.hpp>
#include <hcbf/layout.hpp>
#include <hcbf/march.hpp>
#include <hcbf/shape_terms.hpp>
#include <hcbf/shapes.hpp>

namespace hcbf::ground {

using field::Geometry;
using march::Rank;

// Cost of a metre inside a region through which no path leads: out of it by a short one.
constexpr double CLOSED_COST = 100.0;
// Cost of a metre inside a region of rank 1, 2, 3 or lower that may be crossed.
constexpr double RANK_COST[] = {1e3, 1e3, 1e2, 1e1};
constexpr Index RANK_COSTS = 4;
constexpr double HALO = 0.4;        // up to this distance from an edge a cell costs more than in the open [m]
constexpr double HALO_COST = 20.0;  // by how much, at the edge; it falls with the fourth power: no slits

// Cells with a border around them that no path enters.
struct Ground {
  Matrix<float> cost;  // (ny + 2, nx + 2) of a step through a cell, infinite on the border
  Matrix<Rank> rank;   // (ny + 2, nx + 2) the highest among the regions that a cell is in, 0 in none
};

// Raises cost and rank of one cell, whose centre is so far outside a region [m].
inline void paint(const Ground& ground, Index j, Index i, double free, Index priority, Index opened,
                  double side) {
  float& cost = ground.cost(j, i);
  const auto raise = [&cost](double to) { cost = static_cast<float>(std::max<double>(cost, to)); };
  if (free < 0.0) {
    const bool open = march::is_open(priority, opened);
    raise((open ? RANK_COST[std::min(priority, RANK_COSTS) - 1] : CLOSED_COST) * side);
    Rank& rank = ground.rank(j, i);
    if (rank == 0 || priority < rank) rank = static_cast<Rank>(priority);
  } else if (free < HALO) {
    const double near = 1.0 - free / HALO;
    raise((1.0 + HALO_COST * ((near * near) * (near * near))) * side);
  }
}

// Paints the region of one barrier; see `paint_barriers`, of which this takes one entry each.
inline void paint_barrier(const Ground& ground, const Geometry& g, Index kind, const double* parameters,
                          double t, Index priority, double clearance, Index opened) {
  const Index ny = g.rows(), nx = g.columns();
  Index first_j = 0, end_j = ny, first_i = 0, end_i = nx;
  if (kind != HalfPlane::CODE) {
    const auto [low_x, low_y, high_x, high_y] = shapes::bounds(kind, parameters);
    const double x = 0.5 * (low_x + high_x) + parameters[layout::VELOCITY_X] * t - g.x;
    const double y = 0.5 * (low_y + high_y) + parameters[layout::VELOCITY_Y] * t - g.y;
    const double reach = 0.5 * std::hypot(high_x - low_x, high_y - low_y) + 2.0 * (clearance + HALO);
    const double j = (g.cos * y - g.sin * x) / g.side, i = (g.cos * x + g.sin * y) / g.side;
    const double cells = reach / g.side + 1.0;
    first_j = std::max<Index>(0, static_cast<Index>(j - cells));
    end_j = std::min(ny, static_cast<Index>(j + cells) + 1);
    first_i = std::max<Index>(0, static_cast<Index>(i - cells));
    end_i = std::min(nx, static_cast<Index>(i + cells) + 1);
  }
  for (Index j = first_j; j < end_j; ++j)
    for (Index i = first_i; i < end_i; ++i) {
      const double x = g.x + g.side * (g.cos * i - g.sin * j), y = g.y + g.side * (g.sin * i + g.cos * j);
      const double h = shape_terms::height(kind, parameters, x, y, t);
      paint(ground, j + 1, i + 1, h - clearance, priority, opened, g.side);
    }
}

// Paints the regions of one scene's built-in barriers as they are at time t.
//
// kind: (m,) as in `BarrierSet`, without effect where it is no region; parameters: (m, WIDTH) as in
// `BarrierSet`; priority: (m,) 1 is strict; clearance: (m,) what counts as inside, h below it: margin, body
// radius [m]; opened: ranks from it on may be crossed at their price, above 1; 0 for none.
inline void paint_barriers(const Ground& ground, const Geometry& geometry, Vector<const Index> kind,
                           Matrix<const double> parameters, Vector<const Index> priority,
                           Vector<const double> clearance, double t, Index opened) {
  for (Index k = 0; k < kind.size; ++k)
    if (shape_terms::is_region(kind[k]))
      paint_barrier(ground, geometry, kind[k], parameters[k].data, t, priority[k], clearance[k], opened);
}

// Rows from and to, columns from and to.
struct Window {
  Index first_j, end_j, first_i, end_i;
};

// Returns (ny, nx) exact distances of the centres of a window's cells from its nearest occupied square.
//
// In sides of a cell; infinite beyond `reach` of them along either axis. With n(j, i) the cells to the
// nearest occupied one of the same column, and e(n) = max(0, n - 1/2),
//
//     d^2 = min over |k| <= reach of e(|k|)^2 + e(n(j, i + k))^2.
inline std::vector<float> distances(Matrix<const bool> cells, const Window& window, Index reach) {
  const Index ny = window.end_j - window.first_j, nx = window.end_i - window.first_i;
  std::vector<float> squared(ny * nx);
  std::vector<Index> count(nx, reach + 1);
  const auto next = [&](Index j, Index i) {
    const bool occupied = cells(window.first_j + j, window.first_i + i);
    return count[i] = occupied ? 0 : std::min(count[i] + 1, reach + 1);
  };
  for (Index j = 0; j < ny; ++j)
    for (Index i = 0; i < nx; ++i) squared[j * nx + i] = static_cast<float>(next(j, i));
  std::fill(count.begin(), count.end(), reach + 1);
  for (Index j = ny - 1; j >= 0; --j)
    for (Index i = 0; i < nx; ++i) {
      float& here = squared[j * nx + i];
      const float n = std::min(static_cast<float>(next(j, i)), here);
      const float e = std::max(0.0f, n - 0.5f);
      here = n > static_cast<double>(reach) ? std::numeric_limits<float>::infinity() : e * e;
    }
  std::vector<float> least = squared;
  for (Index j = 0; j < ny; ++j) {
    const float* from = squared.data() + j * nx;
    float* to = least.data() + j * nx;
    for (Index k = 1; k <= std::min(reach, nx - 1); ++k) {
      const float e = static_cast<float>((k - 0.5) * (k - 0.5));
      for (Index i = 0; i < nx - k; ++i) to[i] = std::min(to[i], from[i + k] + e);
      for (Index i = k; i < nx; ++i) to[i] = std::min(to[i], from[i - k] + e);
    }
  }
  for (float& d : least) d = std::sqrt(d);
  return least;
}

// Paints what occupied cells of one rank make of a window of the ground.
//
// window: of the ground, in rows and columns from 1 on; cells: (ny + 2, nx + 2) the occupied ones, whose
// border is what is around the grid; side: of a cell [m]; priority: 1 is strict; clearance: what counts as
// inside, around their squares [m]; opened: ranks from it on may be crossed, 0 for none.
inline void paint_cells(const Ground& ground, const Window& window, Matrix<const bool> cells, double side,
                        Index priority, double clearance, Index opened) {
  const Index reach = static_cast<Index>((clearance + HALO) / side + 0.5) + 1;
  const Index first_j = std::max<Index>(0, window.first_j - reach);
  const Index first_i = std::max<Index>(0, window.first_i - reach);
  const Window seen{first_j, std::min(cells.rows, window.end_j + reach), first_i,
                    std::min(cells.columns, window.end_i + reach)};
  const auto apart = distances(cells, seen, reach);
  const Index columns = seen.end_i - seen.first_i;
  for (Index j = window.first_j; j < window.end_j; ++j)
    for (Index i = window.first_i; i < window.end_i; ++i) {
      const double free = side * apart[(j - seen.first_j) * columns + i - seen.first_i] - clearance;
      if (free < HALO) paint(ground, j, i, free, priority, opened, side);
    }
}

}  // namespace hcbf::ground
