// What a motor can give: less torque, the faster it turns.
#pragma once
#include <algorithm>

#include <hcbf/arrays.hpp>

namespace hcbf::motors {

// Fills in the least and the largest torque (2, 12) that the motors give at `rate` [N·m]:
// τ_max = clip(τ_s (1 − q̇/ω₀), 0, τ_s) and τ_min = −clip(τ_s (1 + q̇/ω₀), 0, τ_s). A motor pulls fully
// at rest and while it brakes, and not at all beyond its no-load speed.
//
// Source: the DC motor of Isaac Lab, whose A1 has 33.5 N·m and 21 rad/s as in Unitree's a1.urdf
// (isaaclab.actuators.DCMotor, isaaclab_assets.robots.unitree.UNITREE_A1_CFG).
inline void torque_limits(Vector<const double> stall, Vector<const double> no_load_speed,
                          Vector<const double> rate, Matrix<double> limits) {
  for (Index joint = 0; joint < 12; ++joint) {
    const double share = rate[joint] / no_load_speed[joint];
    limits(0, joint) = -stall[joint] * std::min(std::max(1.0 + share, 0.0), 1.0);
    limits(1, joint) = stall[joint] * std::min(std::max(1.0 - share, 0.0), 1.0);
  }
}

// Fills in what the motors deliver (12,) of `strength` times the commanded torque (12,) [N·m].
inline void drive(Vector<const double> stall, Vector<const double> no_load_speed, Vector<const double> rate,
                  double strength, Vector<const double> command, Vector<double> delivered) {
  double limits[2][12];
  torque_limits(stall, no_load_speed, rate, {limits[0], 2, 12});
  for (Index joint = 0; joint < 12; ++joint) {
    const double torque = strength * command[joint];
    delivered[joint] = std::min(std::max(torque, limits[0][joint]), limits[1][joint]);
  }
}

}  // namespace hcbf::motors
