// The point before a robot's trunk that follows the reduced-order model.
#pragma once
#include <cmath>

#include <hcbf/arrays.hpp>

namespace hcbf::drive {

// Writes (k, 4) position and velocity of the point, and returns for how many rows they are finite.
// `base` (k, 13): position, quaternion, velocity and turning rate of the trunk; `look_ahead`: ℓ [m].
inline Index tracked(Matrix<const double> base, double look_ahead, Matrix<double> path) {
  for (Index n = 0; n < base.rows; ++n) {
    const double w = base(n, 3), x = base(n, 4), y = base(n, 5), z = base(n, 6);
    const double yaw = std::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z));
    const double ahead_x = look_ahead * std::cos(yaw), ahead_y = look_ahead * std::sin(yaw);
    path(n, 0) = base(n, 0) + ahead_x, path(n, 1) = base(n, 1) + ahead_y;
    path(n, 2) = base(n, 7) - base(n, 12) * ahead_y;
    path(n, 3) = base(n, 8) + base(n, 12) * ahead_x;
    double sum = 0.0;
    for (Index k = 0; k < base.columns; ++k) sum += base(n, k);
    if (!std::isfinite(sum)) return n;
  }
  return base.rows;
}

}  // namespace hcbf::drive
