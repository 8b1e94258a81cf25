// Rows of a differential drive: regions at rest bind its axle, all others the point before it.
//
// A row n·p̈ ≥ b on the axle is one in the point's acceleration u (see `axle`), linear because the
// axle's is,
//
//     ((n·ê) e + (T v/ℓ) (n·ê_⊥) e_⊥)·u ≥ b − v n·(ê − e)/T,
//
// with ê the heading after one period at the present turning rate. docs/rows.md proves when braking
// along the heading meets them all.
#pragma once
#include <cmath>

#include <hcbf/axle.hpp>
#include <hcbf/class_k.hpp>

namespace hcbf::axle_rows {

using axle::Axle;

struct InputRow {  // a·u ≥ b
  double ax, ay, b;
};

// Writes what the axle's acceleration may be at a state x (4,) of the point into `low` and `high`.
inline void limit_axle(const Axle& axle, const double* x, double heading, RowSettings& settings) {
  const double along = axle.braking, across = std::abs(axle::speeds(axle, x, heading).forward) * axle.turn;
  const double cos = std::abs(std::cos(heading)), sin = std::abs(std::sin(heading));
  settings.high[0] = cos * along + sin * across, settings.high[1] = sin * along + cos * across;
  settings.low[0] = -settings.high[0], settings.low[1] = -settings.high[1];
}

// A row in the point's acceleration, of one on the axle's mean one, (nx, ny)·p̈ ≥ b [m/s²]. x (4,) is the
// point's state, `period` T [s], 0 where it is not known.
inline InputRow of_axle(const Axle& axle, const double* x, double heading, double period, double nx,
                        double ny, double b) {
  const auto [v, turning] = axle::speeds(axle, x, heading);
  const double cos = std::cos(heading), sin = std::sin(heading);
  const double later = heading + turning * period, later_cos = std::cos(later), later_sin = std::sin(later);
  const double along = nx * later_cos + ny * later_sin, across = ny * later_cos - nx * later_sin;
  const double turned = period * v / axle.look_ahead * across;
  b -= period > 0.0 ? v * (along - nx * cos - ny * sin) / period : v * turning * across;
  return {along * cos - turned * sin, along * sin + turned * cos, b};
}

// A row on the point: its velocity turns with the heading besides. Arguments as those of `of_axle`.
inline InputRow of_point(const Axle& axle, const double* x, double heading, double period, double nx,
                         double ny, double b) {
  const double turning = axle::speeds(axle, x, heading).turning, turn = turning * period;
  const double cos = std::cos(turn), sin = std::sin(turn);
  const double vx = cos * x[2] - sin * x[3], vy = sin * x[2] + cos * x[3];
  b -= period > 0.0 ? (nx * (vx - x[2]) + ny * (vy - x[3])) / period : turning * (ny * x[2] - nx * x[3]);
  const double turned = period / axle.look_ahead * (ny * vx - nx * vy);
  const double e_x = -std::sin(heading), e_y = std::cos(heading);
  return {cos * nx + sin * ny + turned * e_x, cos * ny - sin * nx + turned * e_y, b};
}

}  // namespace hcbf::axle_rows
