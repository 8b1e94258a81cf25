// Guidance without a goal: a row that goes along the edge which stops the policy.
//
// Where u* presses against a region within `REACH`, the row requests speed along the edge,
//
//     t u >= -k (t v - beta),     t = sigma (n_y, -n_x),
//
// n the unit gradient of the nearest such barrier and sigma = +-1 the side. The side is the one that u* leans
// to when the edge is met; it is retained while something stops the policy, and flipped when the robot is at
// rest for `STUCK` all the same. So single convex regions are passed; a cluster or a trap may not be: that
// takes a field.
//
// Source: the circulation of Gonçalves, Krishnamurthy, Tzes and Khorrami, Control barrier functions with
// circulation inequalities, IEEE TCST 2024, with a latched side.
#pragma once
#include <cmath>

#include <hcbf/arrays.hpp>
#include <hcbf/guidance_row.hpp>
#include <hcbf/shape_terms.hpp>

namespace hcbf::local_guidance {

using guidance_row::Pull, guidance_row::Row;

constexpr double REACH = 0.5;  // within this distance an edge may stop the policy [m]
constexpr double LEAVE = 0.8;  // beyond it, or where u* points away, it does not, and the side is free [m]
constexpr double SLOW = 0.05;  // slower than that the robot is at rest [m/s]
constexpr double STUCK = 1.0;  // being at rest for so long flips the side [s]

// Carried from step to step, zeros at a reset.
struct Memory {
  double side;   // sigma, 0 if free
  double since;  // when the robot came to rest [s]
};

// Returns the row at one state; it requests nothing where nothing stops the policy.
//
// kind: (m,), parameters: (m, WIDTH) as in `BarrierSet`; x: (4,) position [m] and velocity [m/s];
// t: time [s]; u_nominal: (2,) u* [m/s²]; pull: gain and speed.
inline Row circulation(Vector<const Index> kind, Matrix<const double> parameters, const double* x, double t,
                       const double* u_nominal, const Pull& pull, Memory& memory) {
  const bool held = memory.side != 0.0;
  double nearest = held ? LEAVE : REACH, nx = 0.0, ny = 0.0;
  for (Index k = 0; k < kind.size; ++k) {
    if (!shape_terms::is_region(kind[k])) continue;
    const auto jet = shape_terms::jet(kind[k], parameters[k].data, x[0], x[1], t);
    if (!(jet.h < nearest && jet.gx * u_nominal[0] + jet.gy * u_nominal[1] < 0.0)) continue;
    const double norm = std::sqrt(jet.gx * jet.gx + jet.gy * jet.gy);
    nearest = jet.h, nx = jet.gx / norm, ny = jet.gy / norm;
  }
  if (nx == 0.0 && ny == 0.0) {
    memory = {0.0, t};
    return guidance_row::NOTHING;
  }
  if (!held) memory = {ny * u_nominal[0] - nx * u_nominal[1] >= 0.0 ? 1.0 : -1.0, t};
  if (x[2] * x[2] + x[3] * x[3] > SLOW * SLOW) {
    memory.since = t;
  } else if (t - memory.since >= STUCK) {
    memory = {-memory.side, t};
  }
  const double ax = memory.side * ny, ay = -memory.side * nx;
  return {ax, ay, -pull.gain * (ax * x[2] + ay * x[3] - pull.speed)};
}

}  // namespace hcbf::local_guidance
