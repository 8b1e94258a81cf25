// What environments share: observation, the terms of the reward, and the costs of a step.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/layout.hpp>

namespace hcbf::task {

constexpr double CONTROL_DT = 0.02;   // between two actions [s]
constexpr double PHYSICS_DT = 0.002;  // between two evaluations of the barriers [s]
constexpr Index SUBSTEPS = 10;
constexpr double EFFORT_WEIGHT = 1e-3;
constexpr double GOAL_REWARD = 10.0;

// Writes (8 + 4 m,) what the policy of one robot sees: p_ref − p, v_ref − v, v, a_ref, then per barrier
// h, ∇h/‖∇h‖, ∂h/∂t. `x` (4,); `reference` (6,): position, velocity and acceleration; `sensed` (≥ m, 4).
inline void write_observation(const double* x, const double* reference, Matrix<const double> sensed,
                              Vector<double> seen) {
  for (Index k = 0; k < 4; ++k) seen[k] = reference[k] - x[k];
  for (Index k = 0; k < 2; ++k) seen[4 + k] = x[2 + k], seen[6 + k] = reference[4 + k];
  std::copy_n(sensed.data, seen.size - 8, seen.data + 8);
}

// What an input costs.
inline double effort_cost(double ux, double uy) { return -EFFORT_WEIGHT * (ux * ux + uy * uy); }

// The terms of N rewards: what effort costs, by how much the goal came nearer, what reaching it earns.
struct Terms {
  Vector<double> effort, gained, bonus;  // (N,)
};

// `before`, `after` (N,): distances to the goal [m]; `reached` (N,); `u` (N, 2): the applied inputs.
inline void write_terms(Vector<const double> before, Vector<const double> after, Vector<const bool> reached,
                        Matrix<const double> u, const Terms& terms) {
  for (Index i = 0; i < u.rows; ++i) {
    terms.effort[i] = effort_cost(u(i, 0), u(i, 1));
    terms.gained[i] = before[i] - after[i];
    terms.bonus[i] = GOAL_REWARD * reached[i];
  }
}

// Writes by rank (R,) how deep one robot was [m], and returns 1 if rank 1 was entered, else 0. A speed
// limit is a condition of rank 1 and has no metres. A rank beyond R counts with R. `least` (m,): the
// least h in a step.
inline double write_costs(Vector<const double> least, Vector<const Index> kind, Vector<const Index> priority,
                          Vector<double> costs) {
  double cost = 0.0;
  std::fill_n(costs.data, costs.size, 0.0);
  for (Index k = 0; k < least.size; ++k) {
    if (!(least[k] < 0.0)) continue;
    if (priority[k] == 1) cost = 1.0;
    if (kind[k] == layout::SPEED_LIMIT || kind[k] == layout::ZONES) continue;
    double& deepest = costs[std::min(priority[k], costs.size) - 1];
    deepest = std::max(deepest, -least[k]);
  }
  return cost;
}

// Writes the costs (N,), and by rank (N, R) [m], of the least h (N, m) in a step.
inline void costs_of(Matrix<const double> least, Matrix<const Index> kind, Matrix<const Index> priority,
                     Vector<double> cost, Matrix<double> costs) {
  for (Index i = 0; i < least.rows; ++i) cost[i] = write_costs(least[i], kind[i], priority[i], costs[i]);
}

}  // namespace hcbf::task
