// What the simulation of an A1 reports of it.
#pragma once
#include <algorithm>
#include <cmath>

#include <hcbf/locomotion_state.hpp>

namespace hcbf::a1_physics {

constexpr double CONTACT_FORCE = 5.0;  // [N] of the floor on a foot, above which the foot stands on it

// Fills in the vector of a `RobotState` and returns whether it is finite; `foot_forces` (12,) are the
// ground's forces on each foot in the last tick, in the world [N].
inline bool read_state(const double* qpos, const double* qvel, const double* foot_forces, double* state) {
  std::copy(qpos, qpos + 19, state);
  std::copy(qvel, qvel + 18, state + 19);
  for (int foot = 0; foot < 4; ++foot) state[37 + foot] = std::abs(foot_forces[3 * foot + 2]) > CONTACT_FORCE;
  return std::all_of(state, state + locomotion_state::STATE_SIZE, [](double x) { return std::isfinite(x); });
}

}  // namespace hcbf::a1_physics
