// The grid of a field over all that a scene holds.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/arrays.hpp>
#include <hcbf/field.hpp>
#include <hcbf/layout.hpp>
#include <hcbf/shape_terms.hpp>
#include <hcbf/shapes.hpp>

namespace hcbf::extent {

constexpr double PAD = 1.5;          // room around start, goal and regions, for the ways round them [m]
constexpr double BEHIND_WALL = 0.5;  // how far the grid goes beyond a strict wall along an axis [m]
constexpr double CELL = 0.1;         // side of a cell where the scene is not too large for that [m]
constexpr double FINE = 0.05;  // the same where a body has to pass gaps that are little wider than itself [m]
// A larger scene gets larger cells, so that a field takes no longer than 5 ms; of finer cells there may be as
// many as on the same area, and it takes 20 ms.
constexpr double MAX_CELLS = 10000.0;

struct Extent {
  double low[2], high[2];  // x and y [m]
};

// Returns the extent of start (2,), goal (2,) and the bounded regions at time t.
//
// Strict walls along an axis cut it off `BEHIND_WALL` beyond them. kind, parameters, priority: (m,),
// (m, WIDTH) and (m,) as in `BarrierSet`.
inline Extent scene_extent(Vector<const Index> kind, Matrix<const double> parameters,
                           Vector<const Index> priority, const double* start, const double* goal, double t) {
  Extent extent;
  for (int axis = 0; axis < 2; ++axis) {
    extent.low[axis] = std::min(start[axis], goal[axis]);
    extent.high[axis] = std::max(start[axis], goal[axis]);
  }
  for (Index k = 0; k < kind.size; ++k) {
    if (!shape_terms::is_region(kind[k])) continue;
    const auto [low_x, low_y, high_x, high_y] = shapes::bounds(kind[k], parameters[k].data);
    const double low[2] = {low_x, low_y}, high[2] = {high_x, high_y};
    for (int axis = 0; axis < 2; ++axis) {
      const double moved = parameters(k, layout::VELOCITY_X + axis) * t;
      extent.low[axis] = std::min(extent.low[axis], low[axis] + moved);
      extent.high[axis] = std::max(extent.high[axis], high[axis] + moved);
    }
  }
  for (int axis = 0; axis < 2; ++axis) extent.low[axis] -= PAD, extent.high[axis] += PAD;
  for (Index k = 0; k < kind.size; ++k) {
    if (kind[k] != HalfPlane::CODE || priority[k] != 1) continue;
    const double wall = parameters(k, HalfPlane::OFFSET);
    for (int axis = 0; axis < 2; ++axis) {
      const double along = parameters(k, HalfPlane::NORMAL_X + axis);
      if (along == 1.0) extent.low[axis] = std::max(extent.low[axis], wall - BEHIND_WALL);
      if (along == -1.0) extent.high[axis] = std::min(extent.high[axis], BEHIND_WALL - wall);
    }
  }
  return extent;
}

// Returns the geometry of a grid over an extent, its cells larger than `cell` where it is large.
inline field::Geometry geometry_over(const Extent& extent, double cell) {
  const double width = extent.high[0] - extent.low[0], height = extent.high[1] - extent.low[1];
  const double finer = std::min(1.0, cell / CELL);
  double side = std::max(cell, finer * std::sqrt(width * height / MAX_CELLS));
  side = std::max(side, 4.0 * std::max(width, height) / MAX_CELLS);  // a strip is two cells wide at least
  const auto cells = [side](double length) { return std::max(2.0, std::ceil(length / side) + 1.0); };
  return {extent.low[0], extent.low[1], side, cells(height), cells(width), 1.0, 0.0};
}

}  // namespace hcbf::extent
