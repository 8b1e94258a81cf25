// The scan of a simulated robot: rays through a grid, cell by cell.
//
// Source: J. Amanatides and A. Woo, A Fast Voxel Traversal Algorithm for Ray Tracing (1987).
#pragma once
#include <cmath>
#include <limits>

#include <hcbf/arrays.hpp>

namespace hcbf::ros_robot {

// Fills in how far rays from (x, y) go until an occupied cell, all in cells; infinite beyond `reach`.
inline void cast(Matrix<const bool> cells, double x, double y, Vector<const double> angles, double reach,
                 Vector<double> out) {
  for (Index k = 0; k < angles.size; ++k) {
    out[k] = std::numeric_limits<double>::infinity();
    const double dx = std::cos(angles[k]), dy = std::sin(angles[k]);
    auto c = static_cast<Index>(std::floor(x)), r = static_cast<Index>(std::floor(y));
    const Index step_c = dx > 0.0 ? 1 : -1, step_r = dy > 0.0 ? 1 : -1;
    double next_c = std::abs((static_cast<double>(dx > 0.0 ? c + 1 : c) - x) / dx);
    double next_r = std::abs((static_cast<double>(dy > 0.0 ? r + 1 : r) - y) / dy);
    double travelled = 0.0;
    while (travelled < reach) {
      if (0 <= r && r < cells.rows && 0 <= c && c < cells.columns && cells(r, c)) {
        out[k] = travelled;
        break;
      }
      if (next_c < next_r) {
        travelled = next_c;
        next_c += std::abs(1.0 / dx);
        c += step_c;
      } else {
        travelled = next_r;
        next_r += std::abs(1.0 / dy);
        r += step_r;
      }
    }
  }
}

}  // namespace hcbf::ros_robot
